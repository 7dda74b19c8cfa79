//! Bytes that no one meant: an error or voxels, never a panic, never memory without bounds.
//!
//! `ASHFALL_MUTATIONS` sets how many files are made of each seed (a long run takes 100000 and more).

use std::panic::{AssertUnwindSafe, catch_unwind};

use ashfall::import::{Options, RUN_BYTES_MAX, open};
use ashfall::volume::{RawLayout, Size3, VoxelFormat};

use crate::folder::Folder;
use crate::random::Random;
use crate::write::*;

/// Address space that the whole test process may have taken: arenas of its threads included.
const PEAK_BYTES_MAX: u64 = 1 << 30;
/// Voxels that are read of one file before it is taken for good.
const VOXELS_MAX: usize = 1 << 22;

/// One file's time: far above what any takes, far below what a runaway loop takes.
const MUTATION_MS_MAX: u128 = 5000;

/// A small file of each format, plain and packed.
fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let voxels = bytes_of(&values(0, 0), false);
    let nrrd = |encoding: &str, voxels: &[u8]| {
        let header = format!(
            "NRRD0004\ntype: short\ndimension: 4\nsizes: 1 5 4 3\nendian: little\nencoding: {encoding}\n\
             kinds: vector space space space\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n\
             space origin: (1,2,3)\nbyte skip: 0\n\n"
        );
        [header.as_bytes(), voxels].concat()
    };
    let meta = |packed: &str, voxels: &[u8]| {
        let header = format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 5 4 3\nElementSpacing = 1 2 3\nOffset = 0 0 0\n\
             TransformMatrix = 1 0 0 0 1 0 0 0 1\nHeaderSize = 0\nElementNumberOfChannels = 1\n\
             CompressedData = {packed}\nElementType = MET_SHORT\nElementDataFile = LOCAL\n"
        );
        [header.as_bytes(), voxels].concat()
    };
    let nifti = Nifti::new(false, true, &[5, 4, 3, 1]).with(&bytes_of(&values(0, 0), true));
    let array = npy("<i2", false, &[3, 4, 5], &voxels);
    let image = |attributes: &str, array: &str, text: &str| {
        format!(
            "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" {attributes}><ImageData \
             WholeExtent=\"0 4 0 3 0 2\" Origin=\"0 0 0\" Spacing=\"1 1 1\"><Piece Extent=\"0 4 0 3 0 2\">\
             <PointData Scalars=\"a\"><DataArray type=\"Int16\" Name=\"a\" {array}>{text}</DataArray>\
             </PointData></Piece></ImageData>"
        )
    };
    let length = [&120u32.to_le_bytes()[..], &voxels].concat();
    let table = |block: &[u8]| {
        let numbers = [1, 120, 0, block.len() as u32];
        [numbers.map(u32::to_le_bytes).concat(), block.to_vec()].concat()
    };
    let inline = image("", "format=\"binary\"", &base64(&length)) + "</VTKFile>";
    let raw =
        image("", "format=\"appended\" offset=\"0\"", "") + "<AppendedData encoding=\"raw\">_";
    let packed = |name: &str, bytes: &[u8]| {
        let attributes = format!("compressor=\"vtk{name}DataCompressor\"");
        let start = image(&attributes, "format=\"appended\" offset=\"0\"", "");
        [start.as_bytes(), b"<AppendedData encoding=\"raw\">_", &table(bytes)].concat()
    };
    let traces: Vec<_> = (0..6).map(|i| (i / 3, i % 3, 1, bytes_of(&[1, 2, 3, 4], true))).collect();
    let tiff = |big_endian: bool,
                big: bool,
                tiled: bool,
                tags: &[(u16, u64)],
                text: &str,
                bytes: Vec<u8>| {
        let mut all: Vec<Tag> =
            tags.iter().map(|(tag, value)| Tag::Numbers(*tag, vec![*value])).collect();
        all.push(Tag::Text(270, text.to_owned()));
        Tiff { big_endian, big, tiled }.write(&[(all, vec![bytes])])
    };
    let page = [(256, 5), (257, 4), (258, 16), (262, 1), (339, 2)];
    let with = |more: &[(u16, u64)]| [&page[..], more].concat();
    let lzw = weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8)
        .encode(&voxels[..40])
        .unwrap();
    let ome = "<OME><Pixels DimensionOrder='XYZCT' SizeZ='1' SizeC='1' SizeT='1' PhysicalSizeX='1'>\
               <TiffData IFD='0' FirstZ='0' PlaneCount='1'/></Pixels></OME>";
    vec![
        ("raw.raw", voxels.clone()),
        ("raw.gz", gzip(&voxels)),
        ("raw.zst", zstd::stream::encode_all(&voxels[..], 3).unwrap()),
        ("a.nrrd", nrrd("raw", &voxels)),
        ("b.nrrd", nrrd("gzip", &gzip(&voxels))),
        ("a.nii", nifti.clone()),
        ("b.nii.gz", gzip(&nifti)),
        ("c.nii", Nifti::new(true, false, &[5, 4, 3]).with(&voxels)),
        ("a.mha", meta("False", &voxels)),
        ("b.mha", meta("True", &zlib(&voxels))),
        ("a.npy", array.clone()),
        ("a.npz", zip(&[("a.npy", array)], true)),
        ("a.vti", inline.into_bytes()),
        ("b.vti", [raw.as_bytes(), &length].concat()),
        ("c.vti", packed("ZLib", &zlib(&voxels))),
        ("d.vti", packed("LZ4", &lz4_flex::block::compress(&voxels))),
        ("a.sgy", segy(true, 3, 4, &traces)),
        ("b.sgy", segy(false, 1, 2, &traces)),
        (
            "a.tif",
            tiff(
                false,
                false,
                false,
                &page,
                "ImageJ=1.5\nimages=3\nslices=3\nunit=um\n",
                voxels.clone(),
            ),
        ),
        ("b.tif", tiff(true, true, false, &with(&[(259, 5), (317, 2)]), ome, lzw)),
        (
            "c.tif",
            tiff(
                false,
                false,
                true,
                &with(&[(259, 8), (322, 5), (323, 4)]),
                "",
                zlib(&voxels[..40]),
            ),
        ),
    ]
}

fn options(name: &str) -> Options {
    let raw = RawLayout { size: SIZE, format: VoxelFormat::I16, big_endian: false };
    Options { raw: name.starts_with("raw").then_some(raw), ..Options::default() }
}

/// A few changes: bytes, words with meaning, cuts, insertions, digits in text.
fn mutated(seed: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..1 + random.index(4) {
        if bytes.is_empty() {
            break;
        }
        // Headers are at the front, mostly.
        let front = if random.index(3) > 0 { bytes.len().min(400) } else { bytes.len() };
        let at = random.index(front);
        match random.index(9) {
            0 => bytes[at] ^= 1 << random.index(8),
            1 => bytes[at] = random.next() as u8,
            2 => bytes.truncate(at),
            3 => {
                let piece = [0u8, 0xff, 0x7f, 0x80][random.index(4)];
                let end = (at + (1 << random.index(4))).min(bytes.len());
                bytes[at.min(end)..end].fill(piece);
            }
            4 => {
                let word = [u64::MAX, 1 << 60, 1 << 31, i64::MAX as u64, 1 << 20][random.index(5)];
                let word =
                    if random.index(2) == 0 { word.to_le_bytes() } else { word.to_be_bytes() };
                let bytes_used = [2, 4, 8][random.index(3)];
                let end = (at + bytes_used).min(bytes.len());
                bytes[at..end].copy_from_slice(&word[..end - at]);
            }
            5 => {
                let text =
                    ["1152921504606846976", "-1", "0", "nan", "1e300", "99999999999999999999", " "];
                let text = text[random.index(text.len())].bytes();
                // In place of a digit, where there is one.
                let digit =
                    (at..bytes.len()).find(|index| bytes[*index].is_ascii_digit()).unwrap_or(at);
                bytes.splice(digit..digit + 1, text);
            }
            6 => {
                let other = random.index(bytes.len());
                bytes.swap(at, other);
            }
            7 => {
                let end = at + random.index((bytes.len() - at).min(64));
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                let end = at + random.index((bytes.len() - at).min(64));
                bytes.drain(at..end);
            }
        }
    }
    bytes
}

/// Reads a file to its end or its error; whether it was good, or a panic's number of bytes.
fn exercise(scratch: &Folder, name: &str, bytes: &[u8]) -> Result<bool, String> {
    let path = scratch.write(name, bytes);
    let read = || -> Result<bool, String> {
        let mut input = match open(&path, &options(name)) {
            Ok(input) => input,
            Err(why) => return why.message.contains(name).then_some(false).ok_or(why.message),
        };
        let mut voxels = 0;
        loop {
            match input.next_run() {
                Ok(None) => return Ok(true),
                Ok(Some(run)) => {
                    let held = run.voxels.len() * run.voxels.format().bytes();
                    if run.size.len() != Some(run.voxels.len()) || held > 2 * RUN_BYTES_MAX {
                        return Err(format!("a run of {} and {held} bytes", run.size));
                    }
                    voxels += run.voxels.len();
                    if voxels > VOXELS_MAX {
                        return Ok(true);
                    }
                }
                Err(why) if why.exit as u8 == 3 && why.message.contains(name) => return Ok(false),
                Err(why) => return Err(why.message),
            }
        }
    };
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| Err("panic".to_owned()))
}

#[test]
fn mutated_files_are_refused_or_read() {
    let count = std::env::var("ASHFALL_MUTATIONS").ok().and_then(|count| count.parse().ok());
    let count: u64 = count.unwrap_or(1500);
    let scratch = Folder::new("formats");
    for (index, (name, seed)) in seeds().iter().enumerate() {
        assert_eq!(exercise(&scratch, name, seed), Ok(true), "{name} itself");
        let (mut good, mut bad) = (0, 0);
        let start = std::time::Instant::now();
        for number in 0..count {
            let mut random = Random(((index as u64 + 1) << 40) | ((number + 1) * 0x9E37_79B9));
            random.next();
            let bytes = mutated(seed, &mut random);
            let begun = std::time::Instant::now();
            let got = exercise(&scratch, name, &bytes);
            let ms = begun.elapsed().as_millis();
            let got = if ms < MUTATION_MS_MAX { got } else { Err(format!("took {ms} ms")) };
            match got {
                Ok(true) => good += 1,
                Ok(false) => bad += 1,
                Err(why) => {
                    let kept = std::env::temp_dir().join(format!("ashfall-hostile-{name}"));
                    std::fs::write(&kept, &bytes).unwrap();
                    panic!("{name} mutation {number}: {why}; its bytes are in {}", kept.display());
                }
            }
        }
        println!("{name}: {good} good, {bad} bad in {} ms", start.elapsed().as_millis());
        // Both must happen, or the changes test nothing.
        assert!(good > 0 && bad > 0, "{name}: {good} good, {bad} bad");
    }
    assert_peak_is_bounded();
}

#[test]
fn every_truncation_is_refused() {
    let scratch = Folder::new("formats");
    for (name, seed) in seeds() {
        // A SEG-Y file may end with any trace, an archive's and VTK's last bytes hold no voxels.
        let ends: Vec<usize> = match name {
            "a.sgy" | "b.sgy" => (0..seed.len())
                .filter(|end| (end - 3600.min(*end)) % 248 != 0 && end % 3 == 0)
                .collect(),
            "a.vti" => (0..seed.len()
                - "</DataArray></PointData></Piece></ImageData></VTKFile>".len())
                .collect(),
            _ => (0..seed.len()).collect(),
        };
        for end in ends {
            let got = exercise(&scratch, name, &seed[..end]);
            // The trailers of zstd and zlib frames may lack where all voxels are there.
            let trailer = seed.len() - end <= 4
                && matches!(name, "raw.zst" | "b.mha" | "c.vti" | "b.tif" | "c.tif");
            assert!(got == Ok(false) || trailer && got == Ok(true), "{name} cut to {end}: {got:?}");
        }
    }
}

#[test]
fn promises_of_many_voxels_are_refused() {
    let huge = "1048576 1048576 1048576";
    let options = Options::default();
    let raw = Options {
        raw: Some(RawLayout {
            size: Size3::new(1 << 20, 1 << 20, 1 << 20),
            format: VoxelFormat::F32,
            big_endian: false,
        }),
        ..Options::default()
    };
    for (name, bytes) in [
        ("a.raw", vec![0; 9]),
        ("a.raw.gz", gzip(&[0; 9])),
        ("a.raw.zst", zstd::stream::encode_all(&[0; 9][..], 3).unwrap()),
    ] {
        assert!(refusal(name, &bytes, &raw).contains("need 4611686018427387904"));
    }
    for encoding in ["raw", "gzip"] {
        let header =
            format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: {huge}\nencoding: {encoding}\n\n");
        let file = [header.as_bytes(), &gzip(&[0; 9])].concat();
        assert!(refusal("a.nrrd", &file, &options).contains("need 1152921504606846976"));
    }
    for packed in ["False", "True"] {
        let header = format!(
            "NDims = 3\nDimSize = {huge}\nCompressedData = {packed}\nElementType = MET_UCHAR\n\
             ElementDataFile = LOCAL\n"
        );
        let file = [header.as_bytes(), &zlib(&[0; 9])].concat();
        assert!(refusal("a.mha", &file, &options).contains("need 1152921504606846976"));
    }
    let mut nifti = Nifti::new(true, false, &[1, 1, 1]);
    for axis in 1..=3 {
        nifti.put(16 + 8 * axis, &(1u64 << 20).to_le_bytes());
    }
    for file in [nifti.with(&[0; 9]), gzip(&nifti.with(&[0; 9]))] {
        assert!(refusal("a.nii.gz", &file, &options).contains("need 2305843009213693952"));
    }
    let shape = [1 << 20; 3];
    let array = npy("|u1", false, &shape, &[0; 9]);
    for (name, file) in [("a.npy", array.clone()), ("a.npz", zip(&[("a.npy", array)], true))] {
        assert!(refusal(name, &file, &options).contains("need 1152921504606846976"));
    }
    let image = |compressor: &str, numbers: &[u64]| {
        let numbers: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        let extent = "0 1048575 0 1048575 0 1048575";
        format!(
            "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" header_type=\"UInt64\" {compressor}>\
             <ImageData WholeExtent=\"{extent}\"><Piece Extent=\"{extent}\"><PointData>\
             <DataArray type=\"UInt8\" format=\"binary\">{}</DataArray></PointData></Piece></ImageData>",
            base64(&numbers)
        )
    };
    let plain = image("", &[1 << 60, 0]);
    assert!(refusal("a.vti", plain.as_bytes(), &options).contains("need 1152921504606846976"));
    for numbers in [[1 << 45, 1 << 15, 0, 9], [1, 1 << 60, 0, 9], [1 << 60, 1, 0, 9]] {
        let packed = image("compressor=\"vtkZLibDataCompressor\"", &numbers);
        assert!(refusal("a.vti", packed.as_bytes(), &options).contains("cannot hold"));
    }
    let page = |tags: &[(u16, u64)], text: &str| {
        let mut all: Vec<Tag> =
            tags.iter().map(|(tag, value)| Tag::Numbers(*tag, vec![*value])).collect();
        all.push(Tag::Text(270, text.to_owned()));
        Tiff { big_endian: false, big: true, tiled: false }.write(&[(all, vec![vec![0; 9]])])
    };
    for compression in [1, 5, 8, 32773, 50000] {
        let tags = [(256, 1 << 24), (257, 1 << 24), (258, 8), (259, compression), (262, 1)];
        assert!(refusal("a.tif", &page(&tags, ""), &options).contains("at most"));
    }
    let small = [(256, 3), (257, 3), (258, 8), (262, 1)];
    let stack =
        page(&small, "ImageJ=1.5\nimages=1152921504606846976\nslices=1152921504606846976\n");
    assert!(refusal("a.tif", &stack, &options).contains("promises 1152921504606846976 slices"));
    let stack = page(&small, "ImageJ=1.5\nimages=16777216\nslices=16777216\n");
    assert!(refusal("a.tif", &stack, &options).contains("at most"));
    let ome = "<OME><Pixels DimensionOrder='XYZCT' SizeZ='1073741824' SizeC='1' SizeT='1073741824'/></OME>";
    assert!(refusal("a.tif", &page(&small, ome), &options).contains("promises 1073741824 slices"));
    let ome = "<OME><Pixels DimensionOrder='XYZCT' SizeZ='16777216' SizeC='65536' SizeT='16777216'/></OME>";
    assert!(
        refusal("a.tif", &page(&small, ome), &options)
            .contains("promises 16777216 slices, 65536 channels")
    );
    let mut wide = segy(true, 3, 4, &[(1, 1, 1, vec![0; 8])]);
    wide[3500..3502].copy_from_slice(&[2, 0]);
    wide[3268..3272].copy_from_slice(&[0x7f, 0xff, 0xff, 0xff]);
    assert!(refusal("a.sgy", &wide, &options).contains("traces of 2147483647 samples"));
    let lines = [(1, 1), (1 << 30, 1), (3, 1 << 30)].map(|(i, c)| (i, c, 1, vec![0; 8]));
    assert!(
        refusal("a.sgy", &segy(true, 3, 4, &lines), &options).contains("check the byte positions")
    );
    assert_peak_is_bounded();
}

#[test]
fn memory_does_not_grow_with_the_file() {
    // 3 GiB of voxels in a file of about 100 KB: more than the whole process may take.
    let size = Size3::new(2048, 1024, 1536);
    let raw = RawLayout { size, format: VoxelFormat::U8, big_endian: false };
    let options = Options { raw: Some(raw), ..Options::default() };
    let zeros = vec![0; 2048 * 1024];
    let slice = zstd::stream::encode_all(&zeros[..], 3).unwrap();
    let scratch = Folder::new("formats");
    let path = scratch.write("a.raw.zst", slice.repeat(1536));
    let mut input = open(&path, &options).unwrap();
    let mut voxels = 0;
    while let Some(run) = input.next_run().unwrap() {
        assert!(run.voxels.len() <= RUN_BYTES_MAX);
        voxels += run.voxels.len() as u128;
    }
    assert_eq!(voxels, size.voxel_count());
    assert_peak_is_bounded();
}

/// Linux tells the most address space a process ever had; elsewhere nothing is checked.
fn assert_peak_is_bounded() {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return };
    let peak = status.lines().find_map(|line| line.strip_prefix("VmPeak:")).unwrap();
    let kib: u64 = peak.trim().trim_end_matches(" kB").parse().unwrap();
    println!("address space at its peak: {} MiB", kib >> 10);
    assert!(kib << 10 < PEAK_BYTES_MAX, "{kib} KiB of address space were taken");
}
