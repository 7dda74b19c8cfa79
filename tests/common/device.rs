//! A device for a test, watched by validation and held to silence at the end; buffers made by hand.

use std::cell::RefCell;
use std::sync::Arc;

use ashfall::gpu::{
    Buffer, BufferSpec, ComputePipeline, DeviceRequest, Gpu, Image, ImageFormat, ImageSpec,
    Instance, MemoryHome, Recorder, RoleKind, ShaderCompiler, Staging, TimePoint, Validation,
    Variant,
};
use ashfall::passes::SOURCES;

/// An open device. Dropped last, it fails the test for any word of validation.
pub struct Device {
    pub gpu: Arc<Gpu>,
    pub compiler: ShaderCompiler,
    uploaded: RefCell<Vec<TimePoint>>,
    // After `gpu`, so that what the device's end draws is heard too.
    _watch: Watch,
}

struct Watch(Arc<Instance>);

impl Drop for Watch {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let said: Vec<String> = self.0.messages().into_iter().map(|said| said.text).collect();
            assert!(said.is_empty(), "validation says:\n{}", said.join("\n"));
        }
    }
}

/// More than any workgroup beyond the last row writes.
const GUARD_BYTES: usize = 64 << 10;
const NONSENSE: u8 = 0xa5;

/// No device is a failure, unless the environment says out loud that there is none.
pub fn no_device(sentence: &str) {
    assert!(
        std::env::var_os("ASHFALL_NO_DEVICE").is_some(),
        "no Vulkan device: install one, or set ASHFALL_NO_DEVICE=1 to do without: {sentence}"
    );
    eprintln!("SKIPPED, because ASHFALL_NO_DEVICE is set: {sentence}");
}

/// The device that `ASHFALL_DEVICE` names, else one that is a CPU: results that are compared bit by
/// bit must not come from another device unnoticed.
pub fn open() -> Option<(Arc<Gpu>, Arc<Instance>)> {
    open_as(DeviceRequest::default())
}

/// The same device, opened as `request` says.
pub fn open_as(request: DeviceRequest) -> Option<(Arc<Gpu>, Arc<Instance>)> {
    let choice = std::env::var("ASHFALL_DEVICE").ok();
    let request = DeviceRequest { choice: choice.clone(), ..request };
    let opened = Instance::new(Validation::On)
        .and_then(|instance| Ok((Gpu::open(&instance, &request)?, instance)));
    let (gpu, instance) = match opened {
        Ok(opened) => opened,
        Err(why) => {
            no_device(&why.message);
            return None;
        }
    };
    let facts = gpu.facts();
    eprintln!("device: {} ({}), {}", facts.name, facts.kind, facts.driver);
    assert!(
        choice.is_some() || (facts.kind == "cpu" && facts.driver.contains("llvmpipe")),
        "{} is not lavapipe: name it in ASHFALL_DEVICE to test on it",
        facts.name
    );
    Some((gpu, instance))
}

/// As [`open`], held to silence at the end.
pub fn device() -> Option<Device> {
    let (gpu, instance) = open()?;
    Some(Device {
        gpu,
        compiler: ShaderCompiler::new(SOURCES, None),
        uploaded: RefCell::default(),
        _watch: Watch(instance),
    })
}

impl Device {
    /// Whether results equal the twins' bit by bit: CPUs here do each f32 operation as written.
    /// Elsewhere drivers may join a multiplication and an addition.
    pub fn same_bits(&self) -> bool {
        self.gpu.facts().kind == "cpu"
    }

    pub fn pipeline(&self, variant: &Variant) -> Arc<ComputePipeline> {
        let shader = self.compiler.compile(variant).expect("the variant compiles");
        ComputePipeline::new(&self.gpu, shader).expect("a pipeline")
    }

    /// A buffer that holds `values`, and that the host reads back.
    pub fn filled<T: bytemuck::NoUninit>(&self, name: &'static str, values: &[T]) -> Buffer {
        let data: &[u8] = bytemuck::cast_slice(values);
        let spec = BufferSpec { name, bytes: data.len() as u64, home: MemoryHome::Readback };
        let buffer = Buffer::new(&self.gpu, &spec).expect("a buffer");
        buffer.write(0, data).expect("written");
        buffer
    }

    /// Room for `count` values and a guard behind them, full of nonsense.
    pub fn room<T: bytemuck::Pod>(&self, name: &'static str, count: usize) -> Buffer {
        self.filled(name, &vec![NONSENSE; count * size_of::<T>() + GUARD_BYTES])
    }

    /// What was written into a room; nobody may have written behind it.
    pub fn written<T: bytemuck::Pod>(&self, room: &Buffer) -> Vec<T> {
        let mut bytes = self.values::<u8>(room);
        let guard = bytes.split_off(bytes.len() - GUARD_BYTES);
        assert!(guard.iter().all(|byte| *byte == NONSENSE), "{}: written behind it", room.name());
        let mut values = vec![T::zeroed(); bytes.len() / size_of::<T>()];
        bytemuck::cast_slice_mut(&mut values).copy_from_slice(&bytes);
        values
    }

    pub fn values<T: bytemuck::Pod>(&self, buffer: &Buffer) -> Vec<T> {
        let mut values = vec![T::zeroed(); buffer.bytes() as usize / size_of::<T>()];
        buffer.read(0, bytemuck::cast_slice_mut(&mut values)).expect("read");
        values
    }

    pub fn image(&self, size: [u32; 3], format: ImageFormat, texels: &[u8]) -> Image {
        let spec = ImageSpec { name: "image", size, format, stored: false };
        let image = Image::new(&self.gpu, &spec).expect("an image");
        let mut staging = Staging::new(&self.gpu, texels.len() as u64).expect("staging");
        let copied = staging.copy_to_image("upload", texels, &image, [0; 3], size);
        self.uploaded.borrow_mut().push(copied.expect("copied"));
        staging.finish().expect("the copy ends");
        image
    }

    /// Records one submit and waits for its end.
    pub fn run<'r>(&self, record: impl FnOnce(&mut Recorder<'r>)) {
        let mut recorder = Recorder::new(&self.gpu, RoleKind::Render, None);
        record(&mut recorder);
        let submitted = recorder.submit(&self.uploaded.borrow()).expect("submitted");
        self.gpu.wait(submitted.point).expect("it ends");
    }
}
