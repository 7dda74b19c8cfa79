//! What panels and hands know of the volume: histograms, and where rays meet what is shown.

use ashfall::scene::{Channel, Overrides, Scene};
use ashfall::viewer::overview::Overview;
use ashfall::volume::{ChannelVoxels, Size3, VolumeVoxels, Voxels, WorldFromVoxel};

use crate::common::drawing::dense;

/// Nothing before x = 40 of 64, and a wall from there on; a ray along x and one aslant meet it there.
#[test]
fn rays_meet_the_first_thing_that_they_see() {
    let size = Size3::new(64, 48, 40);
    let voxels: Vec<u8> =
        (0..64 * 48 * 40).map(|index| if index % 64 >= 40 { 200 } else { 10 }).collect();
    let channel = ChannelVoxels { voxels: Voxels::U8(voxels), slope: 0.5, intercept: -1.0 };
    let half = [[0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.0]];
    let world_from_voxel = WorldFromVoxel::from_rows(half).expect("a map");
    let volume = VolumeVoxels { size, world_from_voxel, channels: vec![channel] };
    let text = "format = 1\n[[volume]]\nname = \"v\"\nsource = { computed = \"shells\", size = [8, 8, 8] }\n\
        [[volume.channel]]\nwindow = [4.0, 99.0]\ntransfer = [\n\
        { at = 0.5, color = [1, 1, 1], extinction = 0.0 }, { at = 1.0, color = [1, 1, 1], extinction = 30.0 }]\n\
        [[view]]\nname = \"along\"\neye = [-20.0, 12.0, 10.0]\ntarget = [16.0, 12.0, 10.0]\nup = [0, 0, 1]\nfov_degrees = 40\n\
        [[view]]\nname = \"aslant\"\neye = [-5.0, 3.0, 4.0]\ntarget = [20.0, 12.0, 10.0]\nup = [0, 0, 1]\nfov_degrees = 40\n\
        [[view]]\nname = \"away\"\neye = [-20.0, 12.0, 10.0]\ntarget = [-40.0, 12.0, 10.0]\nup = [0, 0, 1]\nfov_degrees = 40\n";
    let scene = Scene::from_toml(text, "scene.toml".as_ref(), &Overrides::default()).expect("it");
    let overview = Overview::new(&dense(volume)).expect("read");
    let channels: &[Channel] = &scene.volumes[0].channels;
    let meets = |view: usize| overview.meets(channels, &scene.views[view], [101, 101], [50, 50]);
    for view in [0, 1] {
        let met = meets(view).expect("the wall");
        assert!((met.at.x - 20.0).abs() <= met.within, "{met:?}");
        assert!(met.within < 1.5 && met.within > 0.1, "{met:?}");
    }
    assert_eq!(meets(2), None);
    // Counts by scaled values: 10 and 200 are 4 and 99.
    let histogram = &overview.histograms[0];
    assert_eq!(histogram.range, [4.0, 99.0]);
    let all = 48 * 40;
    assert_eq!((histogram.bins[0], histogram.bins[255]), (40 * all, 24 * all));
    assert_eq!(histogram.bins[1..255].iter().sum::<u32>(), 0);
}
