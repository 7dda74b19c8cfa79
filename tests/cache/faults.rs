//! Shaders with faults planted in them.

use ashfall::gpu::ShaderCompiler;
use ashfall::passes::SOURCES;

use crate::common::device::Device;

/// A shader, what it says, and what it would say with a fault.
pub type Fault = (&'static str, &'static str, &'static str);

/// Plants each fault alone and asks `notice` what is wrong; fails where it notices nothing.
pub fn all_noticed(
    device: &mut Device,
    faults: &[Fault],
    mut notice: impl FnMut(&Device) -> Option<String>,
) {
    let mut unnoticed = Vec::new();
    for (file, from, to) in faults {
        let mut sources = SOURCES.to_vec();
        let source = sources.iter_mut().find(|(name, _)| name == file).expect("a shader");
        assert_eq!(source.1.matches(from).count(), 1, "{file}: {from}");
        source.1 = source.1.replace(from, to).leak();
        device.compiler = ShaderCompiler::new(sources.leak(), None);
        match notice(device) {
            Some(why) => eprintln!("{file}: {from}: {why}"),
            None => unnoticed.push((file, from, to)),
        }
    }
    assert!(unnoticed.is_empty(), "unnoticed: {unnoticed:#?}");
}
