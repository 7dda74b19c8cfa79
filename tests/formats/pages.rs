//! Variants of TIFF files that the shared volumes do not have.

use std::io::Cursor;

use ashfall::import::{Options, open};
use ashfall::volume::{VoxelFormat, Voxels};
use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype};

use crate::folder::Folder;
use crate::write::*;

/// One page of a slice: i16, rows in strips of three (of four) rows, or tiles of 16 x 16.
fn page(
    z: usize,
    c: usize,
    tiff: &Tiff,
    code: u64,
    pack: fn(&[u8]) -> Vec<u8>,
) -> (Vec<Tag>, Vec<Vec<u8>>) {
    let slice = &values(c, 0)[20 * z..20 * (z + 1)];
    let mut tags = vec![
        Tag::Numbers(256, vec![5]),
        Tag::Numbers(257, vec![4]),
        Tag::Numbers(258, vec![16]),
        Tag::Numbers(259, vec![code]),
        Tag::Numbers(262, vec![1]),
        Tag::Numbers(339, vec![2]),
    ];
    let pieces = if tiff.tiled {
        tags.extend([Tag::Numbers(322, vec![4]), Tag::Numbers(323, vec![3])]);
        // Two across, two down, padded with a value that must not be seen.
        let tile = |tx: usize, ty: usize| -> Vec<i16> {
            let at = |x: usize, y: usize| if x < 5 && y < 4 { slice[x + 5 * y] } else { 9999 };
            (0..12).map(|index| at(4 * tx + index % 4, 3 * ty + index / 4)).collect()
        };
        vec![tile(0, 0), tile(1, 0), tile(0, 1), tile(1, 1)]
    } else {
        tags.push(Tag::Numbers(278, vec![3]));
        vec![slice[..15].to_vec(), slice[15..].to_vec()]
    };
    let pieces = pieces.iter().map(|piece| pack(&bytes_of(piece, tiff.big_endian)));
    (tags, pieces.collect())
}

fn lzw(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8);
    encoder.encode(bytes).unwrap()
}

fn packbits(bytes: &[u8]) -> Vec<u8> {
    // Repeats where two bytes are alike, else literals; a no-op in between.
    let mut out = vec![128];
    for pair in bytes.chunks(2) {
        match pair {
            [a, b] if a == b => out.extend([255, *a]),
            _ => {
                out.push(pair.len() as u8 - 1);
                out.extend(pair);
            }
        }
    }
    out
}

#[test]
fn tiff_strips_and_tiles_of_every_compression() {
    type Pack = fn(&[u8]) -> Vec<u8>;
    let zstd: Pack = |bytes| zstd::stream::encode_all(bytes, 3).unwrap();
    let codes: [(u64, Pack); 6] =
        [(1, <[u8]>::to_vec), (5, lzw), (8, zlib), (32946, zlib), (32773, packbits), (50000, zstd)];
    for (code, pack) in codes {
        for (big_endian, big, tiled) in
            [(false, false, false), (true, false, true), (false, true, true), (true, true, false)]
        {
            let tiff = Tiff { big_endian, big, tiled };
            let pages: Vec<_> = (0..3).map(|z| page(z, 0, &tiff, code, pack)).collect();
            let file = tiff.write(&pages);
            let (header, whole) = read("a.tif", &file, &Options::default()).unwrap();
            assert_eq!((header.size, header.format), (SIZE, VoxelFormat::I16));
            assert_values(&whole.channels[0].voxels, 0, 0);
        }
    }
}

#[test]
fn tiff_of_an_encoder_that_is_not_ours() {
    let (width, height) = (37, 29);
    let shorts: Vec<u16> = (0..width * height).map(|i| (i * i % 50_021) as u16).collect();
    let floats: Vec<f32> = shorts.iter().map(|v| f32::from(*v).sqrt() - 7.0).collect();
    let compressions = [
        Compression::Uncompressed,
        Compression::Lzw,
        Compression::Deflate(DeflateLevel::default()),
        Compression::Packbits,
    ];
    for compression in compressions {
        for predictor in [Predictor::None, Predictor::Horizontal] {
            let mut bytes = Cursor::new(Vec::new());
            let mut encoder = TiffEncoder::new(&mut bytes)
                .unwrap()
                .with_compression(compression)
                .with_predictor(predictor);
            for _ in 0..2 {
                encoder.write_image::<colortype::Gray16>(width, height, &shorts).unwrap();
            }
            let (header, whole) = read("a.tif", bytes.get_ref(), &Options::default()).unwrap();
            assert_eq!(header.size.to_array(), [width, height, 2]);
            let twice = [&shorts[..], &shorts].concat();
            assert_eq!(whole.channels[0].voxels, Voxels::U16(twice));
        }
        let mut bytes = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut bytes).unwrap().with_compression(compression);
        encoder.write_image::<colortype::Gray32Float>(width, height, &floats).unwrap();
        let (_, whole) = read("a.tif", bytes.get_ref(), &Options::default()).unwrap();
        assert_eq!(whole.channels[0].voxels, Voxels::F32(floats.clone()));
    }
}

#[test]
fn tiff_horizontal_predictor_of_both_byte_orders() {
    // Two samples a pixel; each is less the one of the same kind to its left.
    let row = |y: usize| -> Vec<i16> {
        let [a, b] = [values(0, 0), values(1, 0)];
        (5 * y..5 * y + 5).flat_map(|index| [a[index] * 97, b[index]]).collect()
    };
    let rows: Vec<Vec<i16>> = (0..4).map(row).collect();
    let differences = rows.iter().flat_map(|row| {
        (0..10).map(
            |index| if index < 2 { row[index] } else { row[index].wrapping_sub(row[index - 2]) },
        )
    });
    let differences: Vec<i16> = differences.collect();
    for big_endian in [false, true] {
        for compression in [1, 8] {
            let tiff = Tiff { big_endian, big: false, tiled: false };
            let tags = [(256, 5), (257, 4), (259, compression), (262, 1), (277, 2), (317, 2)];
            let mut tags: Vec<Tag> =
                tags.into_iter().map(|(tag, value)| Tag::Numbers(tag, vec![value])).collect();
            tags.extend([Tag::Numbers(258, vec![16; 2]), Tag::Numbers(339, vec![2; 2])]);
            let bytes = bytes_of(&differences, big_endian);
            let bytes = if compression == 8 { zlib(&bytes) } else { bytes };
            let file = tiff.write(&[(tags, vec![bytes])]);
            let (_, whole) = read("a.tif", &file, &Options::default()).unwrap();
            for (c, channel) in whole.channels.iter().enumerate() {
                let want = rows.iter().flat_map(|row| row.iter().skip(c).step_by(2)).copied();
                assert_eq!(channel.voxels, Voxels::I16(want.collect()));
            }
        }
    }
}

#[test]
fn tiff_float_predictor() {
    // By the technical note: bytes of a row split by significance, then differences.
    let floats: Vec<f32> = values(0, 0)[..20].iter().map(|v| f32::from(*v) / 7.0).collect();
    let mut rows = Vec::new();
    for row in floats.chunks(5) {
        let mut split: Vec<u8> =
            (0..4).flat_map(|byte| row.iter().map(move |v| v.to_be_bytes()[byte])).collect();
        for index in (1..split.len()).rev() {
            split[index] = split[index].wrapping_sub(split[index - 1]);
        }
        rows.extend(split);
    }
    for big_endian in [false, true] {
        let tiff = Tiff { big_endian, big: false, tiled: false };
        let tags = [(256, 5), (257, 4), (258, 32), (259, 8), (262, 1), (339, 3), (317, 3)];
        let tags = tags.into_iter().map(|(tag, value)| Tag::Numbers(tag, vec![value])).collect();
        let file = tiff.write(&[(tags, vec![zlib(&rows)])]);
        let (_, whole) = read("a.tif", &file, &Options::default()).unwrap();
        assert_eq!(whole.channels[0].voxels, Voxels::F32(floats.clone()));
    }
}

#[test]
fn tiff_samples_side_by_side_and_in_layers() {
    let [a, b, c] = [values(0, 0), values(1, 0), values(2, 0)].map(|v| v[..20].to_vec());
    let together: Vec<i16> = (0..20).flat_map(|i| [a[i], b[i], c[i]]).collect();
    let tiff = Tiff { big_endian: true, big: false, tiled: false };
    for planar in [1, 2] {
        let tags = [(256, 5), (257, 4), (262, 2), (277, 3), (284, planar), (278, 4)];
        let mut tags: Vec<Tag> =
            tags.into_iter().map(|(tag, value)| Tag::Numbers(tag, vec![value])).collect();
        tags.extend([Tag::Numbers(258, vec![16; 3]), Tag::Numbers(339, vec![2; 3])]);
        let pieces = if planar == 1 {
            vec![together.clone()]
        } else {
            vec![a.clone(), b.clone(), c.clone()]
        };
        let pieces = pieces.iter().map(|piece| bytes_of(piece, true)).collect();
        let (header, whole) =
            read("a.tif", &tiff.write(&[(tags, pieces)]), &Options::default()).unwrap();
        assert_eq!(header.channels, 3);
        for (channel, want) in whole.channels.iter().zip([&a, &b, &c]) {
            assert_eq!(channel.voxels, Voxels::I16(want.clone()));
        }
    }
    let tags = [(256, 5), (257, 4), (258, 8), (262, 2), (277, 4)];
    let tags = tags.into_iter().map(|(tag, value)| Tag::Numbers(tag, vec![value])).collect();
    let colours: Vec<u8> = (0..80).collect();
    let (header, whole) =
        read("a.tif", &tiff.write(&[(tags, vec![colours])]), &Options::default()).unwrap();
    assert_eq!((header.channels, header.format), (1, VoxelFormat::Rgba8));
    let Voxels::Rgba8(got) = &whole.channels[0].voxels else { panic!("not rgba8") };
    assert_eq!(got[19], [76, 77, 78, 79]);
}

fn described(description: &str, planes: &[(usize, usize)], tiff: &Tiff) -> Vec<u8> {
    let mut pages: Vec<_> =
        planes.iter().map(|(z, c)| page(*z, *c, tiff, 1, <[u8]>::to_vec)).collect();
    pages[0].0.push(Tag::Text(270, description.to_owned()));
    pages[0].0.push(Tag::Fraction(282, 4, 1));
    pages[0].0.push(Tag::Fraction(283, 2, 1));
    tiff.write(&pages)
}

const LITTLE: Tiff = Tiff { big_endian: false, big: false, tiled: false };

#[test]
fn imagej_hyperstacks_and_one_directory_for_all_images() {
    let description = "ImageJ=1.53t\nimages=6\nchannels=2\nslices=3\nunit=micron\nspacing=-0.75\n";
    let planes = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)];
    let file = described(description, &planes, &LITTLE);
    // Images behind one another, and only the first has a directory, in strips of three rows.
    let images: Vec<u8> = planes
        .iter()
        .flat_map(|(z, c)| bytes_of(&values(*c, 0)[20 * z..20 * (z + 1)], false))
        .collect();
    let mut tags = page(0, 0, &LITTLE, 1, <[u8]>::to_vec).0;
    tags.push(Tag::Text(270, description.to_owned()));
    tags.extend([Tag::Fraction(282, 4, 1), Tag::Fraction(283, 2, 1)]);
    let contiguous = LITTLE.write(&[(tags, vec![images[..30].to_vec(), images[30..].to_vec()])]);
    for file in [file, contiguous] {
        let (header, whole) = read("a.tif", &file, &Options::default()).unwrap();
        assert_eq!(
            (header.size, header.channels, header.unit.as_deref()),
            (SIZE, 2, Some("micron"))
        );
        assert_eq!(header.world_from_voxel.spacing().to_array(), [0.25, 0.5, 0.75]);
        for (c, channel) in whole.channels.iter().enumerate() {
            assert_values(&channel.voxels, c, 0);
        }
    }
    let short = described(description, &planes[..4], &LITTLE);
    assert!(
        refusal("a.tif", &short, &Options::default())
            .contains("in 6 images, but there are 4 pages")
    );
}

#[test]
fn ome_orders_units_and_missing_planes() {
    let ome = |order: &str, data: &str| {
        format!(
            "<?xml version='1.0'?><OME><Image><Pixels DimensionOrder='{order}' SizeZ='3' SizeC='2' SizeT='1' \
             PhysicalSizeX='0.5' PhysicalSizeZ='2' PhysicalSizeXUnit='nm' PhysicalSizeYUnit='nm' \
             PhysicalSizeZUnit='nm'><Channel/>{data}</Pixels></Image></OME>"
        )
    };
    let by_z = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)];
    let by_c = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)];
    for (order, planes) in [("XYZCT", by_z), ("XYCZT", by_c), ("XYTCZ", by_c)] {
        let (header, whole) =
            read("a.ome.tif", &described(&ome(order, ""), &planes, &LITTLE), &Options::default())
                .unwrap();
        assert_eq!(header.unit.as_deref(), Some("nm"));
        assert_eq!(header.world_from_voxel.spacing().to_array(), [0.5, 1.0, 2.0]);
        for (c, channel) in whole.channels.iter().enumerate() {
            assert_values(&channel.voxels, c, 0);
        }
    }
    // Pages in an order of their own; the second slice of channel 1 is nowhere.
    let planes = [(2, 1), (0, 0), (1, 0), (2, 0), (0, 1)];
    let data: String = planes
        .iter()
        .enumerate()
        .map(|(ifd, (z, c))| {
            format!("<TiffData IFD='{ifd}' FirstZ='{z}' FirstC='{c}' PlaneCount='1'/>")
        })
        .collect();
    let (header, whole) =
        read("a.tif", &described(&ome("XYZCT", &data), &planes, &LITTLE), &Options::default())
            .unwrap();
    assert_eq!((header.format, header.absent_voxels), (VoxelFormat::F32, 20));
    assert_values(&whole.channels[0].voxels, 0, 0);
    let Voxels::F32(got) = &whole.channels[1].voxels else { panic!("not f32") };
    let want = values(1, 0);
    for (index, (got, want)) in got.iter().zip(want).enumerate() {
        let absent = (20..40).contains(&index);
        assert!(if absent { got.is_nan() } else { *got == f32::from(want) }, "voxel {index}");
    }
    let twice = ome("XYZCT", "<TiffData/><TiffData IFD='2'/>");
    let file = described(&twice, &by_z, &LITTLE);
    assert!(refusal("a.tif", &file, &Options::default()).contains("more than once"));
    let foreign = "<TiffData IFD='0'><UUID FileName='b.tif'>urn:uuid:2</UUID></TiffData>";
    let foreign = ome("XYZCT", foreign).replace("<OME>", "<OME UUID='urn:uuid:1'>");
    let file = described(&foreign, &by_z, &LITTLE);
    assert!(refusal("a.tif", &file, &Options::default()).contains("several files"));
}

#[test]
fn reduced_pages_are_passed_over() {
    let mut pages: Vec<_> = (0..3).map(|z| page(z, 0, &LITTLE, 1, <[u8]>::to_vec)).collect();
    let mut small = page(0, 1, &LITTLE, 1, <[u8]>::to_vec);
    small.0.push(Tag::Numbers(254, vec![1]));
    pages.insert(1, small);
    let (header, whole) = read("a.tif", &LITTLE.write(&pages), &Options::default()).unwrap();
    assert_eq!(header.size, SIZE);
    assert_values(&whole.channels[0].voxels, 0, 0);
}

#[test]
fn tiff_refusals() {
    let with = |tag: u16, value: u64| {
        let mut page = page(0, 0, &LITTLE, 1, <[u8]>::to_vec);
        page.0.retain(|known| !matches!(known, Tag::Numbers(other, _) if *other == tag));
        page.0.push(Tag::Numbers(tag, vec![value]));
        LITTLE.write(&[page])
    };
    for (file, why) in [
        (with(259, 7), "compression 7 is not supported"),
        (with(258, 12), "samples of 12 bits"),
        (with(262, 6), "photometric interpretation 6"),
        (with(266, 2), "reversed order"),
        (with(317, 3), "predictor 3 is not supported"),
        (with(256, 0), "promises 0 pixels"),
        (with(257, 40), "14 strips or tiles has 2 offsets"),
        (with(256, 1 << 22), "hold"),
        (b"II\x2a\0\x08\0\0\0\x01\0".to_vec(), "truncated"),
        (b"MM\0\x2a\0\0\0\0".to_vec(), "no page"),
    ] {
        let got = refusal("a.tif", &file, &Options::default());
        assert!(got.contains(why), "{why}: {got}");
    }
    let pages = [page(0, 0, &LITTLE, 5, |bytes| lzw(&bytes[..bytes.len() - 4]))];
    assert!(
        refusal("a.tif", &LITTLE.write(&pages), &Options::default())
            .contains("LZW pixels end too early")
    );
    let mut pages: Vec<_> = (0..2).map(|z| page(z, 0, &LITTLE, 1, <[u8]>::to_vec)).collect();
    pages[1].0[1] = Tag::Numbers(257, vec![5]);
    assert!(
        refusal("a.tif", &LITTLE.write(&pages), &Options::default())
            .contains("page 1: its pages differ")
    );
    // A directory that names itself as the next.
    let mut file = LITTLE.write(&[page(0, 0, &LITTLE, 1, <[u8]>::to_vec)]);
    let (first, end) = (file[4..8].to_vec(), file.len());
    file[end - 4..].copy_from_slice(&first);
    assert!(refusal("a.tif", &file, &Options::default()).contains("circle"));
}

#[test]
fn a_failed_page_ends_the_input() {
    let scratch = Folder::new("formats");
    let mut pages: Vec<_> = (0..3).map(|z| page(z, 0, &LITTLE, 8, zlib)).collect();
    pages[1].1[0] = vec![0x78, 0x9c, 0xff, 0xff];
    let path = scratch.write("a.tif", LITTLE.write(&pages));
    let mut input = open(&path, &Options::default()).unwrap();
    assert!(input.next_run().is_ok());
    assert!(
        input.next_run().unwrap_err().message.contains("page 1: its deflate pixels are damaged")
    );
    assert_eq!(input.next_run().unwrap(), None);
}
