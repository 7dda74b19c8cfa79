//! Variants of NumPy, VTK ImageData and SEG-Y files that the shared volumes do not have.

use ashfall::import::Options;
use ashfall::volume::{VoxelFormat, Voxels};

use crate::write::*;

/// Voxels of channels 0 and 1 with z fastest, then y, x and channel.
fn z_fastest() -> Vec<i16> {
    let mut out = Vec::new();
    for c in 0..2 {
        for x in 0..SIZE.x as usize {
            for y in 0..SIZE.y as usize {
                out.extend((0..SIZE.z as usize).map(|z| value(c, 0, x, y, z)));
            }
        }
    }
    out
}

#[test]
fn numpy_of_both_orders_plain_and_in_archives() {
    for (big_endian, descr) in [(false, "<i2"), (true, ">i2")] {
        let c_order = bytes_of(&[values(0, 0), values(1, 0)].concat(), big_endian);
        // Fortran order has the first axis, channels, fastest.
        let all = [values(0, 0), values(1, 0)];
        let mut fortran = Vec::new();
        for x in 0..5 {
            for y in 0..4 {
                for z in 0..3 {
                    fortran.extend(all.iter().map(|channel| channel[x + 5 * y + 20 * z]));
                }
            }
        }
        let fortran = bytes_of(&fortran, big_endian);
        for array in
            [npy(descr, false, &[2, 3, 4, 5], &c_order), npy(descr, true, &[2, 3, 4, 5], &fortran)]
        {
            let members = [("readme.txt", b"hello".to_vec()), ("a.npy", array.clone())];
            for (name, file) in [
                ("a.npy", array.clone()),
                ("a.npz", zip(&members, true)),
                ("a.npz", zip(&members, false)),
            ] {
                let (header, whole) = read(name, &file, &Options::default()).unwrap();
                assert_eq!((header.size, header.channels), (SIZE, 2));
                for (c, channel) in whole.channels.iter().enumerate() {
                    assert_values(&channel.voxels, c, 0);
                }
            }
        }
        let scalars = npy(descr, true, &[3, 4, 5], &bytes_of(&z_fastest()[..60], big_endian));
        let (_, whole) = read("a.npy", &scalars, &Options::default()).unwrap();
        assert_values(&whole.channels[0].voxels, 0, 0);
    }
}

#[test]
fn numpy_time_and_types() {
    let all: Vec<i16> =
        [(0, 0), (1, 0), (0, 1), (1, 1)].iter().flat_map(|(c, t)| values(*c, *t)).collect();
    let halves: Vec<u8> = all
        .iter()
        .flat_map(|v| half::f16::from_f32(f32::from(*v) / 8192.0).to_le_bytes())
        .collect();
    let longs: Vec<u8> = all.iter().flat_map(|v| i64::from(*v).to_be_bytes()).collect();
    let options = Options { time: 1, ..Options::default() };
    let (header, whole) =
        read("a.npy", &npy(">i8", false, &[2, 2, 3, 4, 5], &longs), &options).unwrap();
    assert_eq!((header.times, header.format), (2, VoxelFormat::F32));
    assert_values(&whole.channels[1].voxels, 1, 1);
    let (_, whole) =
        read("a.npy", &npy("<f2", false, &[2, 2, 3, 4, 5], &halves), &options).unwrap();
    let want = half::f16::from_f32(f32::from(value(0, 1, 0, 0, 0)) / 8192.0).to_f32();
    assert_eq!(whole.channels[0].voxels.value(0), want);
    let (header, _) =
        read("a.npy", &npy("|b1", false, &[7], &[1; 7]), &Options::default()).unwrap();
    assert_eq!((header.size.to_array(), header.format), ([7, 1, 1], VoxelFormat::U8));
    let late = Options { time: 2, ..Options::default() };
    assert!(
        refusal("a.npy", &npy(">i8", false, &[2, 2, 3, 4, 5], &longs), &late)
            .contains("time step 2")
    );
}

#[test]
fn numpy_refusals() {
    let bytes = bytes_of(&values(0, 0), false);
    for (descr, shape, why) in [
        ("<c8", &[3, 4, 5][..], "\"<c8\" are not supported"),
        ("<i2", &[3, 4, 6], "check size and type"),
        ("<i2", &[], "0 axes"),
        ("<i2", &[1, 1, 1, 3, 4, 5], "6 axes"),
        ("<i2", &[3, 0, 5], "promises 0 voxels"),
    ] {
        let got = refusal("a.npy", &npy(descr, false, shape, &bytes), &Options::default());
        assert!(got.contains(why), "{got}");
    }
    let array = npy("<i2", false, &[3, 4, 5], &bytes);
    let mut archive = zip(&[("a.npy", array.clone())], false);
    let last = 30 + 5 + array.len() - 1;
    archive[last] ^= 1;
    assert!(refusal("a.npz", &archive, &Options::default()).contains("checksum is wrong"));
    assert!(
        refusal("a.npz", &archive[..60], &Options::default()).contains("end record is missing")
    );
    assert!(
        refusal("a.npz", &zip(&[("a.txt", array)], true), &Options::default()).contains("no .npy")
    );
}

/// Packs one block.
type Packer = Option<fn(&[u8]) -> Vec<u8>>;

/// An array in VTK's words: a length or a table of blocks, and voxels.
fn vtk_array(voxels: &[u8], packer: Packer, wide: bool, big_endian: bool) -> [Vec<u8>; 2] {
    let number = |value: usize| {
        let bytes = if wide { 8 } else { 4 };
        let mut out = (value as u64).to_le_bytes()[..bytes].to_vec();
        if big_endian {
            out.reverse();
        }
        out
    };
    let Some(packer) = packer else { return [number(voxels.len()), voxels.to_vec()] };
    const BLOCK: usize = 32;
    let blocks: Vec<Vec<u8>> = voxels.chunks(BLOCK).map(packer).collect();
    let mut table = [number(blocks.len()), number(BLOCK), number(voxels.len() % BLOCK)].concat();
    table.extend(blocks.iter().flat_map(|block| number(block.len())));
    [table, blocks.concat()]
}

fn vtk_file(attributes: &str, data: &str, appended: &[u8]) -> Vec<u8> {
    let start = format!(
        "<?xml version=\"1.0\"?>\n<!-- a > comment -->\n<VTKFile type=\"ImageData\" {attributes}>\n{data}\n"
    );
    let mut file = start.into_bytes();
    if !appended.is_empty() {
        file.extend(b"<AppendedData encoding=\"raw\">\n_");
        file.extend(appended);
        file.extend(b"\n</AppendedData>");
    }
    file.extend(b"\n</VTKFile>\n");
    file
}

const IMAGE: &str = "<ImageData WholeExtent='0 4 0 3 0 2' Origin='7 8 9' Spacing='2 3 4'>\
                     <Piece Extent='0 4 0 3 0 2'>";

fn vti(attributes: &str, array: &str, text: &str) -> Vec<u8> {
    let data = format!(
        "{IMAGE}<PointData Scalars='b'>\
         <DataArray type='UInt8' Name='a' format='binary'>{}</DataArray>\
         <DataArray type='Int16' Name='b' {array}>{text}</DataArray>\
         </PointData></Piece></ImageData>",
        base64(&[1, 0, 0, 0, 5])
    );
    vtk_file(attributes, &data, &[])
}

#[test]
fn vti_of_every_encoding() {
    let packers: [(&str, Packer); 3] = [
        ("", None),
        ("compressor='vtkZLibDataCompressor'", Some(zlib)),
        ("compressor='vtkLZ4DataCompressor'", Some(lz4_flex::block::compress)),
    ];
    for big_endian in [false, true] {
        for wide in [false, true] {
            for (compressor, packer) in packers {
                let voxels = bytes_of(&values(0, 0), big_endian);
                let [table, data] = vtk_array(&voxels, packer, wide, big_endian);
                let attributes = format!(
                    "byte_order='{}' header_type='{}' {compressor}",
                    if big_endian { "BigEndian" } else { "LittleEndian" },
                    if wide { "UInt64" } else { "UInt32" },
                );
                let joined = [&table[..], &data].concat();
                // Some writers begin anew after the length, VTK does after a table.
                let texts = [format!("\n{}{}\n", base64(&table), base64(&data)), base64(&joined)];
                let texts = if packer.is_some() { &texts[..1] } else { &texts[..] };
                let mut files: Vec<Vec<u8>> =
                    texts.iter().map(|text| vti(&attributes, "format='binary'", text)).collect();
                let tags = vti(&attributes, "format='appended' offset='3'", "");
                let end = tags.len() - "\n</VTKFile>\n".len();
                let raw = [
                    &tags[..end],
                    b"<AppendedData encoding='raw'> _xyz",
                    &joined,
                    b"</AppendedData></VTKFile>",
                ];
                files.push(raw.concat());
                let text = texts[0].trim();
                let coded =
                    format!("<AppendedData encoding='base64'>_AA={text}</AppendedData></VTKFile>");
                files.push([&tags[..end], coded.as_bytes()].concat());
                for file in files {
                    let (header, whole) = read("a.vti", &file, &Options::default()).unwrap();
                    assert_values(&whole.channels[0].voxels, 0, 0);
                    let rows = header.world_from_voxel.rows();
                    assert_eq!(rows[2], [0.0, 0.0, 4.0, 9.0 - 2.0]);
                }
            }
        }
    }
}

#[test]
fn vti_cells_components_extents_and_turns() {
    let pairs: Vec<i16> =
        values(0, 0).into_iter().zip(values(1, 0)).flat_map(|(a, b)| [a, b]).collect();
    let [table, data] = vtk_array(&bytes_of(&pairs, false), None, false, false);
    let text = base64(&[table, data].concat());
    let data = format!(
        "<ImageData WholeExtent='2 7 0 4 -1 2' Origin='1 0 0' Spacing='2 3 4' Direction='0 -1 0 1 0 0 0 0 1'>\
         <Piece Extent='2 7 0 4 -1 2'><PointData/><CellData>\
         <DataArray type='Int16' Name='c' NumberOfComponents='2' format='binary'>{text}</DataArray>\
         </CellData></Piece></ImageData>"
    );
    let file = vtk_file("byte_order='LittleEndian'", &data, &[]);
    let (header, whole) = read("a.vti", &file, &Options::default()).unwrap();
    assert_eq!((header.size, header.channels), (SIZE, 2));
    for (c, channel) in whole.channels.iter().enumerate() {
        assert_values(&channel.voxels, c, 0);
    }
    // Axis x runs along world y from 2 * 2; z starts at -1 * 4. Cells start at their corners.
    let want = [[0.0, -3.0, 0.0, 1.0], [2.0, 0.0, 0.0, 4.0], [0.0, 0.0, 4.0, -4.0]];
    assert_eq!(header.world_from_voxel.rows(), want);
}

#[test]
fn vti_refusals() {
    let order = "byte_order='LittleEndian'";
    let [table, data] = vtk_array(&bytes_of(&values(0, 0), false), None, false, false);
    let text = base64(&[table, data].concat());
    for (attributes, array, text, why) in [
        (order, "format='ascii'", "1 2 3", "format \"ascii\" are not supported"),
        ("", "format='binary'", &text[..], "byte_order must be"),
        (
            "byte_order='LittleEndian' compressor='vtkLZMADataCompressor'",
            "format='binary'",
            &text,
            "LZMA",
        ),
        (order, "format='appended' offset='0'", "", "AppendedData are missing"),
        (order, "format='binary'", &text[..text.len() - 4], "truncated"),
        (order, "format='binary'", "!!!!", "is not base64"),
        (order, "format='binary' NumberOfComponents='2'", &text, "array has 120 bytes"),
    ] {
        let got = refusal("a.vti", &vti(attributes, array, text), &Options::default());
        assert!(got.contains(why), "{got}");
    }
    let poly = String::from_utf8(vti(order, "format='binary'", &text)).unwrap();
    let poly = poly.replace("type=\"ImageData\"", "type=\"PolyData\"");
    assert!(
        refusal("a.vti", poly.as_bytes(), &Options::default()).contains("not one of ImageData")
    );
}

/// A trace of four samples, by its place in the grid.
fn trace(inline: i32, crossline: i32, kind: u16, big_endian: bool) -> (i32, i32, u16, Vec<u8>) {
    let samples: Vec<i16> = (0..4).map(|s| (s + 10 * crossline + 100 * inline) as i16).collect();
    (inline, crossline, kind, bytes_of(&samples, big_endian))
}

#[test]
fn segy_in_any_order_of_traces() {
    let places: Vec<(i32, i32)> =
        (0..3).flat_map(|i| (0..5).map(move |c| (10 + 2 * i, 7 - 3 * c))).collect();
    let mut orders = vec![places.clone(), places.iter().rev().copied().collect()];
    // Crosslines first.
    let mut turned = places.clone();
    turned.sort_by_key(|(inline, crossline)| (*crossline, *inline));
    orders.push(turned);
    for big_endian in [false, true] {
        for order in &orders {
            let traces: Vec<_> = order.iter().map(|(i, c)| trace(*i, *c, 1, big_endian)).collect();
            let file = segy(big_endian, 3, 4, &traces);
            let (header, whole) = read("a.sgy", &file, &Options::default()).unwrap();
            assert_eq!(header.size.to_array(), [4, 5, 3]);
            assert_eq!((header.format, header.absent_voxels), (VoxelFormat::I16, 0));
            let want = (0..3).flat_map(|i| {
                (0..5).flat_map(move |c| {
                    (0..4).map(move |s| (s + 10 * (3 * c - 5) + 100 * (10 + 2 * i)) as i16)
                })
            });
            assert_eq!(whole.channels[0].voxels, Voxels::I16(want.collect()));
        }
    }
}

#[test]
fn segy_missing_and_dead_traces_are_absent() {
    let traces = [trace(1, 1, 1, true), trace(1, 2, 2, true), trace(2, 2, 1, true)];
    let (header, whole) = read("a.segy", &segy(true, 3, 4, &traces), &Options::default()).unwrap();
    assert_eq!(header.size.to_array(), [4, 2, 2]);
    assert_eq!((header.format, header.absent_voxels), (VoxelFormat::F32, 8));
    let Voxels::F32(got) = &whole.channels[0].voxels else { panic!("not f32") };
    assert_eq!(got[..4], [110.0, 111.0, 112.0, 113.0]);
    assert!(got[4..12].iter().all(|value| value.is_nan()));
    assert_eq!(got[12..], [220.0, 221.0, 222.0, 223.0]);
}

#[test]
fn segy_sample_formats() {
    let ibm: Vec<u8> = [0xC276_A000u32, 0x4110_0000, 0, 0x4019_999A]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let (header, whole) =
        read("a.sgy", &segy(false, 1, 4, &[(1, 1, 1, ibm)]), &Options::default()).unwrap();
    let Voxels::F32(got) = &whole.channels[0].voxels else { panic!("not f32") };
    assert_eq!(got[..3], [-118.625, 1.0, 0.0]);
    assert!((got[3] - 0.1).abs() < 1e-7);
    assert!(header.notes.iter().any(|note| note.contains("IBM")));
    for (format, samples, want) in [
        (5, [1.5f32.to_be_bytes(), (-2f32).to_be_bytes()].concat(), [1.5, -2.0]),
        (6, [1.5f64.to_be_bytes(), (-2f64).to_be_bytes()].concat(), [1.5, -2.0]),
        (2, [7i32.to_be_bytes(), (-2i32).to_be_bytes()].concat(), [7.0, -2.0]),
        (8, vec![7, 0xfe], [7.0, -2.0]),
        (16, vec![7, 0xfe], [7.0, 254.0]),
    ] {
        let file = segy(true, format, 2, &[(1, 1, 1, samples)]);
        let (_, whole) = read("a.sgy", &file, &Options::default()).unwrap();
        let voxels = &whole.channels[0].voxels;
        assert_eq!([voxels.value(0), voxels.value(1)], want, "format {format}");
    }
}

#[test]
fn segy_refusals() {
    let one = trace(1, 1, 1, true);
    let file = segy(true, 3, 4, &[one.clone(), trace(1, 2, 1, true)]);
    for (file, why) in [
        (segy(true, 3, 4, &[one.clone(), one.clone()]), "two traces have inline 1 and crossline 1"),
        (
            segy(true, 3, 4, &[one.clone(), trace(90, 170, 1, true), trace(2, 2, 1, true)]),
            "check the byte positions",
        ),
        (segy(true, 4, 4, std::slice::from_ref(&one)), "sample format 4 is not supported"),
        (segy(true, 77, 4, std::slice::from_ref(&one)), "not known in either byte order"),
        (segy(true, 3, 0, std::slice::from_ref(&one)), "traces of 0 samples"),
        (segy(true, 3, 4, &[]), "not whole traces"),
        (file[..file.len() - 1].to_vec(), "not whole traces"),
        (file[..3300].to_vec(), "file header cannot be read"),
    ] {
        let got = refusal("a.sgy", &file, &Options::default());
        assert!(got.contains(why), "{got}");
    }
    let mut options = Options::default();
    options.segy.inline_byte = 238;
    assert!(refusal("a.sgy", &file, &options).contains("line numbers at byte 238"));
}
