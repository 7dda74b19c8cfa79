//! Copies and fills: many boxes in one step, batches through the staging halves, parts of buffers.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};

use ashfall::gpu::{
    Access, Buffer, BufferRegion, BufferSpec, HostEvent, Image, ImageFormat, ImageRegion,
    ImageSpec, MemoryHome, Place, Record, Recorder, Ring, RoleKind, SlotEvent, Staging, StepKind,
    Submitted, two_queues,
};
use common::device::{Device, device};

const SIZE: [u32; 3] = [8, 4, 6];

fn atlas(device: &Device) -> Image {
    let spec = ImageSpec { name: "atlas", size: SIZE, format: ImageFormat::R8Unorm, stored: false };
    Image::new(&device.gpu, &spec).expect("an image")
}

fn buffer(device: &Device, name: &'static str, bytes: u64, home: MemoryHome) -> Buffer {
    Buffer::new(&device.gpu, &BufferSpec { name, bytes, home }).expect("a buffer")
}

fn bytes_of(device: &Device, image: &Image) -> Vec<u8> {
    device.all_texels(image).iter().map(|texel| (texel[0] * 255.0).round() as u8).collect()
}

/// Puts a box of texels where the device should have put it.
fn put(image: &mut [u8], start: [u32; 3], size: [u32; 3], texels: &[u8]) {
    let mut texels = texels.iter();
    for z in start[2]..start[2] + size[2] {
        for y in start[1]..start[1] + size[1] {
            for x in start[0]..start[0] + size[0] {
                let at = ((z * SIZE[1] + y) * SIZE[0] + x) as usize;
                image[at] = *texels.next().expect("enough texels");
            }
        }
    }
    assert_eq!(texels.next(), None, "too many texels");
}

fn count(size: [u32; 3]) -> usize {
    size.iter().product::<u32>() as usize
}

fn numbered(first: u8, size: [u32; 3]) -> Vec<u8> {
    (0..count(size)).map(|index| first.wrapping_add(index as u8)).collect()
}

#[test]
fn many_boxes_are_one_step_and_lie_where_they_should() {
    let Some(device) = device() else { return };
    let image = atlas(&device);
    let mut expected = numbered(0, SIZE);
    let source = buffer(&device, "source", 1024, MemoryHome::Upload);
    source.write(512, &expected).expect("written");
    let boxes = [([0, 0, 0], [3, 2, 1]), ([5, 1, 2], [3, 3, 4]), ([2, 3, 5], [1, 1, 1])];
    let mut regions = Vec::new();
    let mut offset = 0;
    for (index, (start, size)) in boxes.into_iter().enumerate() {
        let texels = numbered(100 + 50 * index as u8, size);
        source.write(offset, &texels).expect("written");
        put(&mut expected, start, size, &texels);
        regions.push(ImageRegion { buffer_offset: offset, start, size });
        offset = (offset + texels.len() as u64).next_multiple_of(4);
    }
    let mut recorder = Recorder::new(&device.gpu, RoleKind::Transfer, None);
    recorder.copy_to_image("whole", &source, 512, &image, [0; 3], SIZE);
    recorder.copy_regions_to_image("boxes", &source, &image, &regions);
    recorder.copy_regions_to_image("nothing", &source, &image, &[]);
    let submitted = recorder.submit(&[]).expect("submitted");
    device.gpu.wait(submitted.point).expect("it ends");
    assert_eq!(bytes_of(&device, &image), expected);
    let steps = &submitted.record.steps;
    assert_eq!(steps.iter().map(|step| step.label).collect::<Vec<_>>(), ["whole", "boxes"]);
    assert_eq!(steps[1].accesses.len(), 2, "each resource once");
    let read: Vec<_> = steps[1].regions.iter().map(|(_, range, _)| range.clone()).collect();
    assert_eq!(read, [0..6, 8..44, 44..45]);
    assert!(steps[1].barriers.iter().any(|(name, _)| *name == "atlas"), "the second waits");
}

#[test]
fn misplaced_regions_are_our_bug() {
    let Some(device) = device() else { return };
    let spec =
        ImageSpec { name: "wide", size: SIZE, format: ImageFormat::Rgba16Unorm, stored: false };
    let wide = Image::new(&device.gpu, &spec).expect("an image");
    let narrow = atlas(&device);
    let source = buffer(&device, "source", 256, MemoryHome::Upload);
    let refused = |image: &Image, buffer_offset, start, size| {
        let tried = catch_unwind(AssertUnwindSafe(|| {
            let mut recorder = Recorder::new(&device.gpu, RoleKind::Transfer, None);
            let region = ImageRegion { buffer_offset, start, size };
            recorder.copy_regions_to_image("boxes", &source, image, &[region]);
        }));
        tried.is_err()
    };
    assert!(!refused(&narrow, 4, [0; 3], [1; 3]));
    assert!(refused(&narrow, 2, [0; 3], [1; 3]), "no multiple of 4");
    assert!(!refused(&wide, 8, [0; 3], [1; 3]));
    assert!(refused(&wide, 4, [0; 3], [1; 3]), "no multiple of the texel");
    assert!(refused(&narrow, 0, [8, 0, 0], [1; 3]), "outside of the image");
    assert!(refused(&narrow, 0, [0; 3], [1, 0, 1]), "an empty box");
    assert!(!refused(&wide, 0, [0; 3], [8, 4, 1]));
    assert!(refused(&wide, 8, [0; 3], [8, 4, 1]), "outside of the buffer");
    assert!(refused(&narrow, u64::MAX - 3, [0; 3], [8, 4, 6]), "an offset that overflows");
}

#[test]
fn a_batch_goes_to_images_and_buffers_in_one_submit() {
    let Some(device) = device() else { return };
    let images = [atlas(&device), atlas(&device)];
    let places = buffer(&device, "places", 64, MemoryHome::Readback);
    places.write(0, &[7; 64]).expect("written");
    let mut staging = Staging::new(&device.gpu, 1024).expect("staging");
    assert!(staging.flush("copy", &[], &[], &[]).expect("flushed").is_none(), "nothing staged");
    let mut expected = [vec![0; count(SIZE)], vec![0; count(SIZE)]];
    for (index, first) in [(0, 3), (1, 90)] {
        let texels = numbered(first, SIZE);
        assert!(staging.stage_image(&texels, index, [0; 3], SIZE).expect("staged"));
        put(&mut expected[index], [0; 3], SIZE, &texels);
    }
    assert!(staging.stage_buffer(&[1, 2, 3], 0, 5).expect("staged"));
    let place = Place::Buffer { buffer: 0, offset: 60 };
    let filled = staging.stage_with(place, 4, |target| target.copy_from_slice(&[9, 8, 7, 6]));
    assert!(filled.expect("staged"));
    let targets = [&images[0], &images[1]];
    let first = staging.flush("copy", &targets, &[&places], &[]).expect("flushed");
    let first = first.expect("something was staged");
    let kinds: Vec<_> = first.record.steps.iter().map(|step| step.kind.clone()).collect();
    assert_eq!(kinds, [StepKind::CopyToImage, StepKind::CopyToImage, StepKind::CopyToBuffer]);
    let read = |step: usize| first.record.steps[step].regions.clone();
    assert_eq!(read(0), [("staging_half_0", 0..192, Access::CopyRead)]);
    let of_places = [
        ("staging_half_0", 384..387, Access::CopyRead),
        ("staging_half_0", 400..404, Access::CopyRead),
        ("places", 5..8, Access::CopyWrite),
        ("places", 60..64, Access::CopyWrite),
    ];
    assert_eq!(read(2), of_places);

    // The other half, over a part of what the first one wrote.
    let (start, size) = ([1, 1, 1], [5, 2, 3]);
    let texels = numbered(200, size);
    assert!(staging.stage_image(&texels, 0, start, size).expect("staged"));
    put(&mut expected[0], start, size, &texels);
    let second = staging.flush("copy", &[&images[0]], &[], &[first.point]).expect("flushed");
    let second = second.expect("something was staged");
    assert_eq!(second.record.steps[0].regions[0].0, "staging_half_1");
    let copy_ms = staging.finish().expect("it ends");
    assert!(copy_ms > 0.0 || !device.gpu.has_timestamps(RoleKind::Transfer));
    for (image, expected) in images.iter().zip(&expected) {
        assert_eq!(&bytes_of(&device, image), expected);
    }
    let mut wanted = [7; 64];
    wanted[5..8].copy_from_slice(&[1, 2, 3]);
    wanted[60..].copy_from_slice(&[9, 8, 7, 6]);
    assert_eq!(device.values::<u8>(&places), wanted);
}

#[test]
fn a_full_half_says_so_and_many_halves_keep_their_order() {
    let Some(device) = device() else { return };
    let image = atlas(&device);
    let mut staging = Staging::new(&device.gpu, 256).expect("staging");
    let size = [8, 4, 1];
    let mut flushes = 0;
    for round in 0..50u8 {
        let texels = numbered(round, size);
        let start = [0, 0, u32::from(round) % SIZE[2]];
        let staged = staging.stage_image(&texels, 0, start, size).expect("staged");
        // 256 bytes hold eight slices, but a batch may not write one place twice.
        if !staged || start[2] == SIZE[2] - 1 {
            staging.flush("copy", &[&image], &[], &[]).expect("flushed").expect("staged");
            flushes += 1;
        }
        assert!(staged);
    }
    assert!(staging.flush("copy", &[&image], &[], &[]).expect("flushed").is_some());
    staging.finish().expect("it ends");
    assert_eq!(flushes, 50 / SIZE[2]);
    // The last two rounds of each slice number: 48 and 49 in slices 0 and 1, 44 to 47 behind.
    let mut expected = vec![0; count(SIZE)];
    for round in 44..50u8 {
        let start = [0, 0, u32::from(round) % SIZE[2]];
        put(&mut expected, start, size, &numbered(round, size));
    }
    assert_eq!(bytes_of(&device, &image), expected);
    for _ in 0..8 {
        assert!(staging.stage_image(&[1; 32], 0, [0; 3], size).expect("staged"));
    }
    assert!(!staging.stage_image(&[1], 0, [0; 3], [1; 3]).expect("asked"), "no byte is left");
    assert!(!staging.stage_buffer(&[0; 257], 0, 0).expect("asked"), "larger than any half");
}

#[test]
fn buffers_are_filled_and_copied_in_parts() {
    let Some(device) = device() else { return };
    let first = buffer(&device, "first", 64, MemoryHome::Device);
    let second = buffer(&device, "second", 64, MemoryHome::Readback);
    let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
    recorder.fill("clear", &first, 0, 64, 0x0101_0101);
    recorder.fill("part", &first, 8, 4, 0x0403_0201);
    recorder.fill("clear", &second, 0, 64, u32::MAX);
    recorder.copy_buffer("copy", &first, 9, &second, 1, 5);
    recorder.host_read(&second);
    let submitted = recorder.submit(&[]).expect("submitted");
    let mut wanted = [255; 64];
    wanted[1..6].copy_from_slice(&[2, 3, 4, 1, 1]);
    assert_eq!(device.values::<u8>(&second), wanted);
    let steps = &submitted.record.steps;
    assert_eq!(steps[1].kind, StepKind::Fill);
    assert_eq!(steps[1].accesses, [("first", Access::CopyWrite)]);
    assert_eq!(steps[1].regions, [("first", 8..12, Access::CopyWrite)]);
    assert_eq!(steps[1].barriers.len(), 1, "fill after fill");
    assert_eq!(steps[3].barriers.len(), 2, "both sides of the copy wait");
    let refused = |offset, bytes| {
        let filled = || {
            let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
            recorder.fill("clear", &first, offset, bytes, 0);
        };
        catch_unwind(AssertUnwindSafe(filled)).is_err()
    };
    assert!(!refused(60, 4));
    assert!(refused(2, 4) && refused(4, 6) && refused(4, 0) && refused(64, 4));
}

/// Frames that read an atlas while bricks are copied into other slots of it, recorded for real.
#[test]
fn what_staging_records_is_proved_to_be_in_order() {
    let Some(device) = device() else { return };
    let slot = [4, 4, 3];
    let start = |index: u32| [index % 2 * 4, 0, index / 2 * 3];
    let image = atlas(&device);
    let table = buffer(&device, "table", 64, MemoryHome::Device);
    let mut staging = Staging::new(&device.gpu, 128).expect("staging");
    let mut records: Vec<Record> = Vec::new();
    let mut copied = Vec::new();
    for round in 0..12u32 {
        // Frame: publish what was copied two frames ago, grant another slot.
        let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
        recorder.prepare(&image);
        recorder.fill("publish", &table, 0, 4, round);
        recorder.fill("grant", &table, 4, 4, round);
        let arrived = (round >= 2).then(|| copied[round as usize - 2]);
        let waits: Vec<_> = arrived.into_iter().collect();
        let mut frame = recorder.submit(&waits).expect("submitted");
        let steps = &mut frame.record.steps;
        let last = steps.len() - 1;
        if round >= 2 {
            steps[last - 1].slots.push((SlotEvent::Published, (round - 2) % 4));
        }
        steps[last].slots.push((SlotEvent::Granted, round % 4));
        records.push(frame.record);
        let texels = numbered(round as u8, slot);
        assert!(staging.stage_image(&texels, 0, start(round % 4), slot).expect("staged"));
        let flushed = staging.flush("copy", &[&image], &[], &[frame.point]).expect("flushed");
        let mut flushed = flushed.expect("staged");
        flushed.record.steps[0].slots.push((SlotEvent::CopiedInto, round % 4));
        flushed.record.steps[0].by_slot.push("atlas");
        copied.push(flushed.point);
        records.push(flushed.record);
    }
    staging.finish().expect("it ends");
    records.push(Record::of_host(staging.take_host_events()));
    assert_eq!(two_queues::check(&records), []);
    // Without the host's own waits, it would overwrite halves that are being read.
    for record in &mut records {
        record.host.retain(|event| !matches!(event, HostEvent::Waited(_)));
    }
    let faults = two_queues::check(&records);
    let overwrites = |fault: &_| matches!(fault, two_queues::Fault::OverwrittenByHost { .. });
    assert!(faults.iter().any(overwrites), "{faults:?}");
}

/// Copies a batch from a ring into `target`, at its place among batches of 64 bytes, after `work`.
fn copied_behind(
    device: &Device,
    ring: &mut Ring,
    batch: u8,
    target: &Buffer,
    work: &[&Buffer],
) -> Submitted {
    let (range, host) = ring.write(&[batch; 64]).expect("written");
    let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
    for filled in work {
        recorder.fill("work", filled, 0, filled.bytes(), 7);
    }
    let (source_offset, target_offset) = (range.start, u64::from(batch) * 64);
    let region = BufferRegion { source_offset, target_offset, bytes: 64 };
    recorder.copy_regions_to_buffer("batch", ring.buffer(), target, &[region]);
    let mut submitted = recorder.submit(&[]).expect("submitted");
    ring.read_until(submitted.point);
    submitted.record.host = host;
    submitted
}

#[test]
fn a_ring_waits_only_for_what_it_overwrites() {
    let Some(device) = device() else { return };
    let large = buffer(&device, "large", 64 << 20, MemoryHome::Device);
    let target = buffer(&device, "target", 7 * 64, MemoryHome::Readback);
    let spec = BufferSpec { name: "ring", bytes: 3 * 64 + 63, home: MemoryHome::Upload };
    let mut ring = Ring::new(&device.gpu, &spec).expect("a ring");
    // So much that the host is well ahead.
    let work = [&large; 60];
    let mut records = Vec::new();
    let mut points = Vec::new();
    for batch in 0..7 {
        let work = if batch == 0 { &work[..] } else { &[] };
        let submitted = copied_behind(&device, &mut ring, batch, &target, work);
        if batch == 2 {
            assert!(!device.gpu.has_reached(points[0]), "the host waited for the first batch");
        }
        let start = u64::from(batch % 3) * 64;
        let wrote = HostEvent::Wrote { buffer: "ring", range: start..start + 64 };
        let wanted = match usize::from(batch).checked_sub(3) {
            None => vec![wrote],
            Some(before) => vec![HostEvent::Waited(points[before]), wrote],
        };
        assert_eq!(submitted.record.host, wanted, "batch {batch}");
        points.push(submitted.point);
        records.push(submitted.record);
    }
    device.gpu.wait(points[6]).expect("it ends");
    let wanted: Vec<u8> = (0..7).flat_map(|batch| [batch; 64]).collect();
    assert_eq!(device.values::<u8>(&target), wanted, "a batch was overwritten before it was read");
    assert!(two_queues::check(&records).is_empty());
    // Who does not wait would be found out.
    records[3].host.remove(0);
    let faults = two_queues::check(&records);
    let overwritten = |fault: &two_queues::Fault| {
        matches!(fault, two_queues::Fault::OverwrittenByHost { buffer: "ring", .. })
    };
    assert!(faults.iter().any(overwritten), "{faults:?}");
}

#[test]
fn batches_of_all_sizes_go_round_a_ring() {
    let Some(device) = device() else { return };
    let size = |batch: u32| 4 * (1 + u64::from(batch * batch * 37 % 250));
    let batches = 0..200;
    let target = buffer(&device, "target", batches.clone().map(size).sum(), MemoryHome::Readback);
    let spec = BufferSpec { name: "ring", bytes: 1000, home: MemoryHome::Upload };
    let mut ring = Ring::new(&device.gpu, &spec).expect("a ring");
    let (mut records, mut wanted) = (Vec::new(), Vec::new());
    for batch in batches {
        let content = vec![batch as u8; size(batch) as usize];
        let (range, host) = ring.write(&content).expect("written");
        assert!(range.end - range.start == size(batch) && range.end <= 1000, "{range:?}");
        let (source_offset, target_offset) = (range.start, wanted.len() as u64);
        let region = BufferRegion { source_offset, target_offset, bytes: size(batch) };
        let mut recorder = Recorder::new(&device.gpu, RoleKind::Render, None);
        recorder.copy_regions_to_buffer("batch", ring.buffer(), &target, &[region]);
        let mut submitted = recorder.submit(&[]).expect("submitted");
        ring.read_until(submitted.point);
        submitted.record.host = host;
        records.push(submitted.record);
        wanted.extend(content);
    }
    assert_eq!(device.values::<u8>(&target), wanted);
    let faults = two_queues::check(&records);
    assert!(faults.is_empty(), "{faults:?}");
}
