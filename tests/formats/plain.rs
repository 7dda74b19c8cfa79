//! Variants of raw, NRRD, NIfTI and MetaImage files that the shared volumes do not have.

use ashfall::import::{Options, open};
use ashfall::volume::{RawLayout, VoxelFormat, Voxels};

use crate::folder::Folder;
use crate::write::*;

fn raw(format: VoxelFormat, big_endian: bool) -> Options {
    Options { raw: Some(RawLayout { size: SIZE, format, big_endian }), ..Options::default() }
}

/// Rows of an affine of voxel centres, from ours.
fn centre_rows(header: &ashfall::import::Header) -> [[f64; 4]; 3] {
    header.world_from_voxel.rows().map(|[a, b, c, t]| [a, b, c, t + 0.5 * (a + b + c)])
}

fn assert_close(got: [[f64; 4]; 3], want: [[f64; 4]; 3]) {
    for (got, want) in got.iter().flatten().zip(want.iter().flatten()) {
        assert!((got - want).abs() < 1e-5, "{got:?} is not {want:?}");
    }
}

#[test]
fn raw_files_of_every_compression_and_byte_order() {
    for big_endian in [false, true] {
        let bytes = bytes_of(&values(0, 0), big_endian);
        let (front, back) = bytes.split_at(17);
        let zstd = |bytes: &[u8]| zstd::stream::encode_all(bytes, 3).unwrap();
        for (name, bytes) in [
            ("a.raw", bytes.clone()),
            ("a.raw.gz", gzip(&bytes)),
            ("a.RAW.GZ", [gzip(front), gzip(back)].concat()),
            ("a.raw.zst", [zstd(front), zstd(back)].concat()),
        ] {
            let (header, whole) = read(name, &bytes, &raw(VoxelFormat::I16, big_endian)).unwrap();
            assert_eq!((header.size, header.format_name), (SIZE, "raw"));
            assert_values(&whole.channels[0].voxels, 0, 0);
        }
    }
}

#[test]
fn raw_files_of_every_type() {
    let floats: Vec<f32> = values(0, 0).iter().map(|v| f32::from(*v) + 0.25).collect();
    let bytes: Vec<u8> = floats.iter().flat_map(|v| v.to_be_bytes()).collect();
    let (_, whole) = read("a.raw", &bytes, &raw(VoxelFormat::F32, true)).unwrap();
    assert_eq!(whole.channels[0].voxels, Voxels::F32(floats));
    // Colours are bytes: their order does not turn with the byte order.
    let (_, whole) = read("a.raw", &bytes, &raw(VoxelFormat::Rgba8, true)).unwrap();
    let colours = bytes.chunks_exact(4).map(|four| four.try_into().unwrap()).collect();
    assert_eq!(whole.channels[0].voxels, Voxels::Rgba8(colours));
}

#[test]
fn raw_files_that_do_not_fit_are_refused() {
    let bytes = bytes_of(&values(0, 0), false);
    let options = raw(VoxelFormat::I16, false);
    assert_eq!(
        refusal("a.raw", &bytes[..119], &options),
        "holds 119 bytes of voxels, but 5 x 4 x 3 voxels of i16 need 120; check size and type"
    );
    assert!(refusal("a.raw", &[&bytes[..], &[0]].concat(), &options).contains("holds 121 bytes"));
    let packed = gzip(&bytes);
    for cut in 1..packed.len() {
        let why = refusal("a.raw.gz", &packed[..cut], &options);
        assert!(
            why.contains("gzip") && (why.contains("truncated") || why.contains("at most")),
            "{why}"
        );
    }
    let packed = zstd::stream::encode_all(&bytes[..], 3).unwrap();
    assert!(
        refusal("a.zst", &packed[..packed.len() - 3], &options)
            .contains("zstd voxels are truncated")
    );
    for (name, more) in [
        ("a.gz", gzip(&[&bytes[..], &[0]].concat())),
        ("a.zst", zstd::stream::encode_all(&[&bytes[..], &[0]].concat()[..], 3).unwrap()),
    ] {
        assert!(refusal(name, &more, &options).contains("go on after the 120 bytes"));
    }
    let mut damaged = gzip(&bytes);
    let checksum = damaged.len() - 6;
    damaged[checksum] ^= 1;
    assert!(refusal("a.gz", &damaged, &options).contains("damaged"));
    let unknown = refusal("a.raw", &bytes, &Options::default());
    assert!(unknown.contains("--raw-size"), "{unknown}");
    assert!(refusal("a.xyz", &bytes, &Options::default()).contains("format is not known"));
    let missing = open("/nowhere/a.nrrd".as_ref(), &Options::default()).err().unwrap();
    assert!(missing.message.starts_with("/nowhere/a.nrrd: cannot be read"), "{missing}");
}

#[test]
fn spacing_given_replaces_the_files_own() {
    let options = Options { spacing: Some([2.0, 3.0, 4.0]), ..Options::default() };
    let file =
        nrrd("sizes: 5 4 3\nspacings: 1 1 9\nendian: little\n", &bytes_of(&values(0, 0), false));
    let (header, _) = read("a.nrrd", &file, &options).unwrap();
    assert_eq!(header.world_from_voxel.rows()[2], [0.0, 0.0, 4.0, 0.0]);
    let wrong = Options { spacing: Some([0.0, 1.0, 1.0]), ..Options::default() };
    assert!(refusal("a.nrrd", &file, &wrong).contains("spacing must be positive"));
}

/// A raw NRRD of three dimensions and type short, unless the fields say otherwise.
fn nrrd(fields: &str, voxels: &[u8]) -> Vec<u8> {
    let mut header = String::from("NRRD0005\n# made by a test\nkey:=a value: with colon\n");
    for (name, default) in [("type", "short"), ("dimension", "3"), ("encoding", "raw")] {
        if !fields.contains(&format!("{name}:")) {
            header += &format!("{name}: {default}\n");
        }
    }
    [header.as_bytes(), fields.as_bytes(), b"\n", voxels].concat()
}

#[test]
fn nrrd_of_both_byte_orders_attached_and_detached() {
    for (big_endian, endian) in [(false, "little"), (true, "big")] {
        let bytes = bytes_of(&values(0, 0), big_endian);
        let fields = format!("sizes: 5 4 3\nendian: {endian}\n");
        let packed = format!("{fields}encoding: gz\n");
        let crlf = String::from_utf8(nrrd(&fields, &[])).unwrap().replace('\n', "\r\n");
        for file in [
            nrrd(&fields, &bytes),
            nrrd(&packed, &gzip(&bytes)),
            nrrd(&format!("{packed}byte skip: 7\n"), &gzip(&[&[9; 7], &bytes[..]].concat())),
            nrrd(&format!("{fields}byte skip: -1\n"), &[&[9; 30], &bytes[..]].concat()),
            nrrd(&format!("{fields}line skip: 2\n"), &[b"one\ntwo\n", &bytes[..]].concat()),
            [crlf.as_bytes(), &bytes].concat(),
        ] {
            let (_, whole) = read("a.nrrd", &file, &Options::default()).unwrap();
            assert_values(&whole.channels[0].voxels, 0, 0);
        }
        let scratch = Folder::new("formats");
        scratch.write("voxels.bin", &bytes);
        let header = scratch.write("a.nhdr", nrrd(&format!("{fields}datafile: voxels.bin\n"), &[]));
        assert_values(&whole(&header, &Options::default()).unwrap().1.channels[0].voxels, 0, 0);
    }
}

#[test]
fn nrrd_with_channels_first_and_time_last() {
    let mut bytes = Vec::new();
    for t in 0..2 {
        let channels = [values(0, t), values(1, t), values(2, t)];
        let voxels =
            (0..channels[0].len()).flat_map(|index| channels.iter().map(move |c| c[index]));
        bytes.extend(bytes_of(&voxels.collect::<Vec<_>>(), true));
    }
    let fields = "dimension: 5\nsizes: 3 5 4 3 2\nendian: big\nkinds: vector domain domain domain time\n\
                  space dimension: 3\nspace directions: none (2,0,0) (0,3,0) (1,0,4) none\n\
                  space origin: (7,8,9)\nspace units: \"mm\" \"mm\" \"mm\"\n";
    for time in 0..2 {
        let options = Options { time, ..Options::default() };
        let (header, whole) = read("a.nrrd", &nrrd(fields, &bytes), &options).unwrap();
        assert_eq!((header.size, header.channels, header.times), (SIZE, 3, 2));
        assert_eq!(header.unit.as_deref(), Some("mm"));
        for (c, channel) in whole.channels.iter().enumerate() {
            assert_values(&channel.voxels, c, time as usize);
        }
        let want = [[2.0, 0.0, 1.0, 7.0], [0.0, 3.0, 0.0, 8.0], [0.0, 0.0, 4.0, 9.0]];
        assert_close(centre_rows(&header), want);
    }
    let late = Options { time: 2, ..Options::default() };
    assert!(refusal("a.nrrd", &nrrd(fields, &bytes), &late).contains("time step 2"));
}

#[test]
fn nrrd_types_are_widened_or_named() {
    let doubles: Vec<u8> = values(0, 0).iter().flat_map(|v| f64::from(*v).to_le_bytes()).collect();
    let file = nrrd("type: double\nsizes: 5 4 3\nendian: little\n", &doubles);
    let (header, whole) = read("a.nrrd", &file, &Options::default()).unwrap();
    assert_values(&whole.channels[0].voxels, 0, 0);
    assert!(header.notes.iter().any(|note| note.contains("f64")), "{:?}", header.notes);
    let longs: Vec<u8> = values(0, 0).iter().flat_map(|v| i32::from(*v).to_be_bytes()).collect();
    let file = nrrd("type: int\nsizes: 5 4 3\nendian: big\n", &longs);
    let (header, whole) = read("a.nrrd", &file, &Options::default()).unwrap();
    assert_values(&whole.channels[0].voxels, 0, 0);
    assert!(header.notes.iter().any(|note| note.contains("16777216")), "{:?}", header.notes);
    let bytes: Vec<u8> = (0..60u8).map(|v| v.wrapping_sub(30)).collect();
    let file = nrrd("type: int8\nsizes: 5 4 3\n", &bytes);
    let (_, whole) = read("a.nrrd", &file, &Options::default()).unwrap();
    assert_eq!(whole.channels[0].voxels, Voxels::I16((-30..30).collect()));
    let colours: Vec<u8> = (0..240).collect();
    let fields = "type: uchar\ndimension: 4\nsizes: 4 5 4 3\nkinds: RGBA-color space space space\n";
    let (header, _) = read("a.nrrd", &nrrd(fields, &colours), &Options::default()).unwrap();
    assert_eq!((header.channels, header.format), (1, VoxelFormat::Rgba8));
}

#[test]
fn nrrd_headers_that_cannot_be_are_refused() {
    let bytes = bytes_of(&values(0, 0), false);
    for (fields, why) in [
        ("sizes: 5 4 3\n", "endian"),
        ("sizes: 5 4\nendian: little\n", "2 sizes and dimension 3"),
        ("sizes: 5 4 0\nendian: little\n", "promises 0 voxels"),
        ("sizes: 5 4 2\nendian: little\n", "check size and type"),
        ("sizes: 5 4 x\nendian: little\n", "\"x\" is not a number"),
        ("sizes: 5 4 3\nendian: little\nencoding: bzip2\n", "\"bzip2\" is not supported"),
        ("type: block\nsizes: 5 4 3\nendian: little\n", "\"block\" is not supported"),
        ("sizes: 5 4 3\nendian: little\nspace directions: (1,0,0) (0,1,0) (1,1,0)\n", "singular"),
        ("sizes: 5 4 3\nendian: little\ndata file: LIST\n", "many files"),
        (
            "sizes: 5 4 3\nendian: little\ndata file: gone.raw\n",
            "data file gone.raw: cannot be read",
        ),
        ("no colon\n", "is not \"field: value\""),
    ] {
        let got = refusal("a.nrrd", &nrrd(fields, &bytes), &Options::default());
        assert!(got.contains(why), "{fields:?}: {got}");
    }
}

#[test]
fn nifti_of_both_versions_and_byte_orders() {
    for (v2, big_endian) in [(false, false), (false, true), (true, false), (true, true)] {
        let mut header = Nifti::new(v2, big_endian, &[5, 4, 3, 2, 2]);
        header.real(112, 176, 0, 0.5);
        header.real(116, 184, 0, -3.0);
        let sform = [[2.0, 0.0, 0.5, -7.0], [0.0, -3.0, 0.0, 8.0], [0.25, 0.0, 4.0, 9.0]];
        header.put(if v2 { 348 } else { 254 }, &1u16.to_le_bytes());
        if v2 {
            header.put(348, &1u32.to_le_bytes());
            header.put(500, &2u32.to_le_bytes());
        } else {
            header.bytes[123] = 2;
        }
        for (row, entries) in sform.iter().enumerate() {
            for (column, entry) in entries.iter().enumerate() {
                header.real(280 + 16 * row, 400 + 32 * row, column, *entry);
            }
        }
        // x, y, z, time, channel.
        let order = [(0, 0), (0, 1), (1, 0), (1, 1)];
        let all: Vec<i16> = order.iter().flat_map(|(c, t)| values(*c, *t)).collect();
        let file = header.with(&bytes_of(&all, big_endian));
        for (name, file) in [("a.nii", file.clone()), ("a.nii.gz", gzip(&file))] {
            for time in 0..2 {
                let options = Options { time, ..Options::default() };
                let (header, whole) = read(name, &file, &options).unwrap();
                assert_eq!(header.scaling, [(0.5, -3.0); 2]);
                assert_eq!(
                    (header.channels, header.times, header.unit.as_deref()),
                    (2, 2, Some("mm"))
                );
                assert_close(centre_rows(&header), sform);
                for (c, channel) in whole.channels.iter().enumerate() {
                    assert_eq!((channel.slope, channel.intercept), (0.5, -3.0));
                    assert_values(&channel.voxels, c, time as usize);
                }
            }
        }
    }
}

#[test]
fn nifti_qform_spacing_and_pairs() {
    let voxels = bytes_of(&values(0, 0), false);
    let mut header = Nifti::new(false, false, &[5, 4, 3]);
    for (index, spacing) in [-1.0, 2.0, 3.0, 4.0].into_iter().enumerate() {
        header.real(76, 104, index, spacing);
    }
    let (plain, _) = read("a.nii", &header.with(&voxels), &Options::default()).unwrap();
    let spacing = [[2.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0]];
    assert_close(centre_rows(&plain), spacing);
    // A quarter turn about z takes x to y and y to -x; qfac turns z around.
    header.put(252, &1u16.to_le_bytes());
    header.real(256, 352, 2, std::f64::consts::FRAC_1_SQRT_2);
    for (index, offset) in [5.0, 6.0, 7.0].into_iter().enumerate() {
        header.real(268, 376, index, offset);
    }
    let (turned, _) = read("a.nii", &header.with(&voxels), &Options::default()).unwrap();
    let want = [[0.0, -3.0, 0.0, 5.0], [2.0, 0.0, 0.0, 6.0], [0.0, 0.0, -4.0, 7.0]];
    assert_close(centre_rows(&turned), want);
    // A singular sform is passed over with a note, not fatal.
    header.put(254, &1u16.to_le_bytes());
    let (turned, _) = read("a.nii", &header.with(&voxels), &Options::default()).unwrap();
    assert_close(centre_rows(&turned), want);
    assert!(turned.notes.iter().any(|note| note.contains("sform is ignored")));

    header.bytes[344..348].copy_from_slice(b"ni1\0");
    header.put(108, &0f32.to_le_bytes());
    let scratch = Folder::new("formats");
    let path = scratch.write("a.hdr", &header.bytes[..348]);
    assert!(
        whole(&path, &Options::default()).unwrap_err().message.contains("a.img, which is missing")
    );
    scratch.write("a.img", &voxels);
    assert_values(&whole(&path, &Options::default()).unwrap().1.channels[0].voxels, 0, 0);
}

#[test]
fn nifti_colours_and_refusals() {
    let voxels = bytes_of(&values(0, 0), false);
    let mut header = Nifti::new(false, false, &[5, 4, 3]);
    header.put(70, &128u16.to_le_bytes());
    let colours: Vec<u8> = (0..180).collect();
    let (known, whole) = read("a.nii", &header.with(&colours), &Options::default()).unwrap();
    assert_eq!((known.channels, known.format), (3, VoxelFormat::U8));
    assert_eq!(whole.channels[1].voxels, Voxels::U8((0..60).map(|v| 3 * v + 1).collect()));
    for (offset, bytes, why) in [
        (70, &1u16.to_le_bytes()[..], "datatype 1 "),
        (40, &9u16.to_le_bytes(), "9 dimensions"),
        (42, &0u16.to_le_bytes(), "dim[1] is 0"),
        (108, &7f32.to_le_bytes(), "inside the header"),
        (108, &f32::NAN.to_le_bytes(), "byte NaN"),
        (108, &1e6f32.to_le_bytes(), "bytes before the voxels"),
        (344, b"\0\0\0\0", "magic"),
    ] {
        let mut header = Nifti::new(false, false, &[5, 4, 3]);
        header.put(offset, bytes);
        let got = refusal("a.nii", &header.with(&voxels), &Options::default());
        assert!(got.contains(why), "{why}: {got}");
    }
}

fn metaimage(fields: &str, voxels: &[u8]) -> Vec<u8> {
    let mut header = String::from("ObjectType = Image\nNDims = 3\nDimSize = 5 4 3\n");
    if !fields.contains("ElementType =") {
        header += "ElementType = MET_SHORT\n";
    }
    header += fields;
    // The field after which voxels begin.
    if !fields.contains("ElementDataFile =") {
        header += "ElementDataFile = LOCAL\n";
    }
    [header.as_bytes(), voxels].concat()
}

#[test]
fn metaimage_byte_orders_channels_and_turns() {
    for big_endian in [false, true] {
        let pairs = values(0, 0).into_iter().zip(values(1, 0)).flat_map(|(a, b)| [a, b]);
        let bytes = bytes_of(&pairs.collect::<Vec<_>>(), big_endian);
        let order = if big_endian { "True" } else { "False" };
        let fields = format!(
            "BinaryDataByteOrderMSB = {order}\nElementNumberOfChannels = 2\n\
             ElementSpacing = 2 3 4\nPosition = 7 8 9\nTransformMatrix = 0 1 0 0 0 1 1 0 0\n"
        );
        let packed = format!("{fields}CompressedData = True\n");
        for file in [
            metaimage(&fields, &bytes),
            metaimage(&packed, &zlib(&bytes)),
            metaimage(&format!("{fields}HeaderSize = -1\n"), &[&[1; 9], &bytes[..]].concat()),
        ] {
            let (header, whole) = read("a.mha", &file, &Options::default()).unwrap();
            assert_eq!(header.channels, 2);
            for (c, channel) in whole.channels.iter().enumerate() {
                assert_values(&channel.voxels, c, 0);
            }
            // x runs along world y, y along z, z along x.
            let want = [[0.0, 0.0, 4.0, 7.0], [2.0, 0.0, 0.0, 8.0], [0.0, 3.0, 0.0, 9.0]];
            assert_close(centre_rows(&header), want);
        }
        let scratch = Folder::new("formats");
        scratch.write("b.raw", &bytes);
        let path =
            scratch.write("b.mhd", metaimage(&format!("{fields}ElementDataFile = b.raw\n"), &[]));
        assert_values(&whole(&path, &Options::default()).unwrap().1.channels[1].voxels, 1, 0);
    }
}

#[test]
fn metaimage_refusals() {
    let bytes = bytes_of(&values(0, 0), false);
    for (fields, why) in [
        ("BinaryData = False\n", "voxels as text"),
        ("ElementType = MET_STRING\n", "\"MET_STRING\" is not supported"),
        ("ElementDataFile = LIST\n", "many files"),
        ("CompressedData = maybe\n", "must be True or False"),
        ("ElementSpacing = 1 2\n", "has 2 numbers, not 3"),
        ("ElementNumberOfChannels = 0\n", "promises 0 channels"),
        ("ElementNumberOfChannels = 2\n", "check size and type"),
        ("no equals\n", "is not \"Field = value\""),
    ] {
        let got = refusal("a.mha", &metaimage(fields, &bytes), &Options::default());
        assert!(got.contains(why), "{fields:?}: {got}");
    }
    let packed = zlib(&bytes);
    let fields = "CompressedData = True\n";
    let cut = metaimage(fields, &packed[..packed.len() - 9]);
    assert!(refusal("a.mha", &cut, &Options::default()).contains("zlib voxels are truncated"));
    let more = metaimage(fields, &zlib(&[&bytes[..], &[0]].concat()));
    assert!(refusal("a.mha", &more, &Options::default()).contains("go on after"));
}
