//! The store's bytes: the page that draws them, golden files, cut files, flipped bits, mutations.

mod folder;
mod random;
mod support;

use std::path::Path;

use ashfall::error::Exit;
use ashfall::source::BrickSource;
use ashfall::store::layout::{self, Field};
use ashfall::store::{Compression, Store, verify};
use ashfall::volume::{Size3, VoxelFormat};
use folder::Folder;
use random::Random;
use support::{Volume, settings, voxels};

/// Offset, name and bytes of every field of a drawing.
type Drawing = Vec<(usize, String, usize)>;

/// The drawings of docs/FORMAT.md, each with its heading.
fn drawings() -> Vec<(String, Drawing)> {
    let page = include_str!("../docs/FORMAT.md");
    let mut drawings: Vec<(String, Drawing)> = Vec::new();
    let (mut heading, mut drawing) = (String::new(), false);
    for line in page.lines() {
        if let Some(text) = line.strip_prefix("## ") {
            heading = text.to_owned();
        } else if line == "```" {
            drawing = !drawing;
            if drawing {
                drawings.push((heading.clone(), Vec::new()));
            }
        } else if drawing {
            let (offset, fields) = line.split_once(' ').unwrap();
            let mut offset: usize = offset.strip_prefix('+').unwrap().parse().unwrap();
            for field in fields.split('|') {
                let (name, bytes) = field.trim().split_once(' ').unwrap();
                let bytes: usize = bytes.parse().unwrap();
                drawings.last_mut().unwrap().1.push((offset, name.to_owned(), bytes));
                offset += bytes;
            }
        }
    }
    drawings
}

#[test]
fn the_page_draws_what_the_code_does() {
    let structures: [(&str, &[Field]); 7] = [
        ("Header", layout::header::FIELDS),
        ("Description", layout::description::FIELDS),
        ("Channel", layout::channel::FIELDS),
        ("Level", layout::level::FIELDS),
        ("Index page", layout::page::FIELDS),
        ("Entry", layout::entry::FIELDS),
        ("Trailer", layout::trailer::FIELDS),
    ];
    let drawings = drawings();
    assert_eq!(drawings.len(), structures.len());
    for ((heading, drawn), (name, fields)) in drawings.iter().zip(structures) {
        assert_eq!(heading, name);
        let fields: Vec<_> =
            fields.iter().map(|field| (field.offset, field.name.to_owned(), field.bytes)).collect();
        assert_eq!(*drawn, fields, "{name}");
        let page = include_str!("../docs/FORMAT.md");
        for (_, field, _) in drawn {
            assert!(page.contains(&format!("`{field}`")), "{field} has no paragraph");
        }
    }
}

/// `NAME = struct.Struct("<...")` of Python: where its items begin, and last where they end.
fn item_offsets(python: &str, name: &str) -> Vec<usize> {
    let start = format!("{name} = struct.Struct(\"<");
    let items = python.split_once(&start).unwrap().1.split('"').next().unwrap();
    let (mut offsets, mut count) = (vec![0], String::new());
    for item in items.chars() {
        if item.is_ascii_digit() {
            count.push(item);
            continue;
        }
        let number = count.parse().unwrap_or(1);
        count.clear();
        // Of a string the count is its bytes.
        let (times, bytes) = match item {
            's' => (1, number),
            'B' => (number, 1),
            'I' | 'f' => (number, 4),
            'Q' | 'd' => (number, 8),
            _ => panic!("{name}: {item}"),
        };
        for _ in 0..times {
            offsets.push(offsets.last().unwrap() + bytes);
        }
    }
    offsets
}

#[test]
fn the_comparison_with_vtk_reads_what_the_code_writes() {
    let python = include_str!("../tools/compare_vtk/store.py");
    let structures: [(&str, &[Field]); 4] = [
        ("HEADER", layout::header::FIELDS),
        ("DESCRIPTION", layout::description::FIELDS),
        ("CHANNEL", layout::channel::FIELDS),
        ("ENTRY", layout::entry::FIELDS),
    ];
    for (name, fields) in structures {
        let offsets = item_offsets(python, name);
        let end = fields.last().map(|field| field.offset + field.bytes);
        assert_eq!(offsets.last().copied(), end, "{name}");
        for field in fields {
            assert!(offsets.contains(&field.offset), "{name}: {} begins elsewhere", field.name);
        }
    }
    let (header, entries) = (layout::page::BYTES, layout::PAGE_ENTRIES);
    let said = format!("PAGE_HEADER_BYTES, PAGE_ENTRIES = {header}, {entries}\n");
    assert!(python.contains(&said), "{said}");
}

#[test]
fn the_page_states_the_code_s_numbers() {
    let page = include_str!("../docs/FORMAT.md");
    let hex = |bytes: [u8; 8]| bytes.map(|byte| format!("{byte:02X}")).join(" ");
    for number in [
        format!("the bytes {}", hex(layout::MAGIC)),
        format!("the bytes {}", hex(layout::END_MAGIC)),
        format!("`version`: {}.", layout::VERSION),
        format!("`header_bytes`: {},", layout::header::BYTES),
        format!("index_place + {} * page", layout::PAGE_BYTES),
        format!("{} of these in a page", layout::PAGE_ENTRIES),
        format!("each 1 to {}.", layout::PAYLOAD_MAX),
        format!("1 to {}.", layout::CHANNEL_COUNT_MAX),
        format!("1 to {}.", layout::LEVEL_COUNT_MAX),
        format!("at most {} MiB", layout::DESCRIPTION_BYTES_MAX >> 20),
    ] {
        assert!(page.contains(&number), "the page lacks: {number}");
    }
}

/// One small store per format and compression.
fn golden_volumes() -> Vec<(String, Volume, ashfall::import::Settings)> {
    let mut random = Random(11);
    let mut golden = Vec::new();
    for format in VoxelFormat::ALL {
        let size = Size3::new(7, 6, 5);
        let mut volume = Volume::of(size, [1.0, 1.0, 2.0], voxels(format, size, &mut random, true));
        if format == VoxelFormat::U8 {
            volume.channels.push(ashfall::volume::Voxels::U8(vec![9; 210]));
        }
        if format == VoxelFormat::F32 {
            volume.absent_slices = vec![0, 1, 2];
        }
        let compression =
            if format == VoxelFormat::U16 { Compression::None } else { Compression::Lz4 };
        let settings = settings(Size3::cube(4), 64, 2, compression);
        golden.push((format!("version_1_{format}.bricks"), volume, settings));
    }
    golden
}

/// Small stores of this version as they always were, LZ4 blocks as the pinned lz4_flex makes them. Set ASHFALL_WRITE_GOLDEN to write new ones,
/// which is right only together with a new version.
#[test]
fn golden_stores_are_made_byte_by_byte() {
    let folder = Folder::in_memory();
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    for (name, volume, settings) in golden_volumes() {
        let path = folder.path(&name);
        volume.import(&path, &settings).unwrap();
        let made = std::fs::read(&path).unwrap();
        if std::env::var_os("ASHFALL_WRITE_GOLDEN").is_some() {
            std::fs::create_dir_all(&golden).unwrap();
            std::fs::write(golden.join(&name), &made).unwrap();
        }
        let kept = std::fs::read(golden.join(&name)).unwrap();
        assert!(made == kept, "{name} has other bytes than the golden store");
        Store::open(&golden.join(&name)).unwrap();
    }
}

fn small_store(folder: &Folder) -> Vec<u8> {
    let mut random = Random(2);
    let size = Size3::new(9, 5, 4);
    let mut volume = Volume::of(size, [1.0; 3], voxels(VoxelFormat::F32, size, &mut random, false));
    volume.absent_slices = vec![3];
    let path = folder.path("small.bricks");
    volume.import(&path, &settings(Size3::new(4, 4, 2), 64, 1, Compression::Lz4)).unwrap();
    std::fs::read(&path).unwrap()
}

/// What reading all of a store gives: an error at the door, named bricks, or nothing wrong.
enum Found {
    Refused,
    Named,
    Nothing,
}

fn look(path: &Path) -> Found {
    match verify(path, &|_, _| {}) {
        Err(why) => {
            assert_eq!(why.exit, Exit::Input);
            Found::Refused
        }
        Ok(report) if report.damaged_bricks > 0 => {
            assert!(!report.damages.is_empty());
            assert!(report.damages.iter().all(|damage| !damage.message.is_empty()));
            Found::Named
        }
        Ok(_) => Found::Nothing,
    }
}

#[test]
fn every_cut_is_refused() {
    let folder = Folder::in_memory();
    let whole = small_store(&folder);
    let path = folder.path("cut.bricks");
    for len in 0..whole.len() {
        std::fs::write(&path, &whole[..len]).unwrap();
        assert!(matches!(look(&path), Found::Refused), "cut to {len} bytes");
    }
    std::fs::write(&path, [&whole[..], &[0]].concat()).unwrap();
    assert!(matches!(look(&path), Found::Refused), "one byte more");
    std::fs::write(&path, &whole).unwrap();
    assert!(matches!(look(&path), Found::Nothing), "the whole store is whole");
}

#[test]
fn every_flipped_bit_is_refused_or_named() {
    let folder = Folder::in_memory();
    let whole = small_store(&folder);
    let store = Store::open(&folder.path("small.bricks")).unwrap();
    let index_place = layout::header::INDEX_PLACE.u64(&whole) as usize;
    let description_place = layout::header::DESCRIPTION_PLACE.u64(&whole) as usize;
    let path = folder.path("flipped.bricks");
    let mut named = 0;
    for bit in 0..whole.len() * 8 {
        let mut bytes = whole.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        std::fs::write(&path, &bytes).unwrap();
        let in_bricks = (layout::header::BYTES..description_place).contains(&(bit / 8));
        match look(&path) {
            Found::Refused => assert!(!in_bricks, "bit {bit} of a brick refuses the whole store"),
            Found::Named => {
                assert!(in_bricks, "bit {bit} of header or description is named as a brick");
                named += 1;
            }
            Found::Nothing => panic!("bit {bit} is not noticed"),
        }
        // A damaged brick is an error when it is read, and the others still come.
        if (layout::header::BYTES..index_place).contains(&(bit / 8)) && bit % 61 == 0 {
            let damaged = Store::open(&path).unwrap();
            let ids: Vec<_> = store.description().bricks().collect();
            let failed = ids.iter().filter(|&&id| damaged.read_voxels(id).is_err()).count();
            assert_eq!(failed, 1, "bit {bit}");
        }
    }
    assert!(named > 0);
}

#[test]
fn an_index_page_in_another_s_place_is_named() {
    use layout::{PAGE_BYTES, PAGE_ENTRIES, header};
    let folder = Folder::in_memory();
    let size = Size3::new(16, 16, 2);
    let volume = Volume::of(size, [1.0; 3], voxels(VoxelFormat::U8, size, &mut Random(1), false));
    let path = folder.path("pages.bricks");
    volume.import(&path, &settings(Size3::cube(1), 64, 1, Compression::Lz4)).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let index = header::INDEX_PLACE.u64(&bytes) as usize;
    let (first, second) = bytes[index..index + 2 * PAGE_BYTES].split_at_mut(PAGE_BYTES);
    first.swap_with_slice(second);
    std::fs::write(&path, &bytes).unwrap();
    let report = verify(&path, &|_, _| {}).unwrap();
    assert_eq!(report.damaged_bricks, 2 * PAGE_ENTRIES as u64);
    assert_eq!(report.damages.len(), 2, "a page is named once");
    let store = Store::open(&path).unwrap();
    assert!(store.entry(store.numbering().brick(0)).is_err());
    assert!(store.entry(store.numbering().brick(2 * PAGE_ENTRIES as u64)).is_ok());
}

/// Sets every checksum right, so that what lies under them is met.
fn with_checksums(bytes: &mut [u8]) {
    use layout::{PAGE_BYTES, checksum, header, page, trailer};
    let len = bytes.len();
    if len < header::BYTES + trailer::BYTES {
        return;
    }
    let place = |field: Field| field.u64(&bytes[..header::BYTES]) as usize;
    let (index, description) = (place(header::INDEX_PLACE), place(header::DESCRIPTION_PLACE));
    let description_end = description.saturating_add(place(header::DESCRIPTION_BYTES));
    if index <= description && description <= len {
        for page_bytes in bytes[index..description].chunks_mut(PAGE_BYTES) {
            if page_bytes.len() > page::BYTES {
                let sum = checksum(&page_bytes[page::CHECKSUM.end()..]);
                page::CHECKSUM.set(page_bytes, &sum.to_le_bytes());
            }
        }
    }
    if description <= description_end && description_end <= len {
        let sum = checksum(&bytes[description..description_end]);
        header::DESCRIPTION_CHECKSUM.set(bytes, &sum.to_le_bytes());
    }
    let sum = checksum(&bytes[..header::HEADER_CHECKSUM.offset]).to_le_bytes();
    header::HEADER_CHECKSUM.set(bytes, &sum);
    trailer::HEADER_CHECKSUM.set(&mut bytes[len - trailer::BYTES..], &sum);
}

#[test]
fn a_range_that_is_not_the_voxels_is_named() {
    use layout::{entry, header, page};
    let folder = Folder::in_memory();
    let mut bytes = small_store(&folder);
    let first = header::INDEX_PLACE.u64(&bytes) as usize + page::BYTES;
    let range = &mut bytes[first..first + entry::BYTES];
    let wider = entry::GREATEST.f32(range) + 1.0;
    entry::GREATEST.set(range, &wider.to_le_bytes());
    with_checksums(&mut bytes);
    let path = folder.path("range.bricks");
    std::fs::write(&path, &bytes).unwrap();
    let report = verify(&path, &|_, _| {}).unwrap();
    assert_eq!(report.damaged_bricks, 1);
    assert!(report.damages[0].message.contains("range"), "{}", report.damages[0].message);
}

/// No panic and no runaway allocation, whatever the bytes. Long runs: ASHFALL_LONG=1.
#[test]
fn mutated_stores_are_read_or_refused() {
    let rounds = if std::env::var_os("ASHFALL_LONG").is_some() { 1_000_000 } else { 6_000 };
    let folder = Folder::in_memory();
    let whole = small_store(&folder);
    let path = folder.path("mutated.bricks");
    let mut random = Random(77);
    let interesting = [0u64, 1, 0x7F, 0x80, 0xFF, u64::MAX, i64::MAX as u64, 1 << 60, 1 << 32];
    let (mut opened, mut refused) = (0, 0);
    for round in 0..rounds {
        let mut bytes = whole.clone();
        for _ in 0..1 + random.below(3) {
            // Mostly what is not voxels.
            let place = match random.below(4) {
                0 => random.below(bytes.len() as u64),
                1 => random.below(layout::header::BYTES.min(bytes.len()) as u64),
                _ => bytes.len() as u64 - 1 - random.below(bytes.len() as u64 / 3 + 1),
            } as usize;
            match random.below(4) {
                0 => bytes[place] = random.next() as u8,
                1 => bytes[place] ^= 1 << random.below(8),
                2 => bytes.truncate(place.max(1)),
                _ => {
                    let number = interesting[random.below(interesting.len() as u64) as usize];
                    let number = number.to_le_bytes();
                    let end = (place + 1 + random.below(8) as usize).min(bytes.len());
                    let len = end - place;
                    bytes[place..end].copy_from_slice(&number[..len]);
                }
            }
        }
        if round % 8 != 0 {
            with_checksums(&mut bytes);
        }
        std::fs::write(&path, &bytes).unwrap();
        match Store::open(&path) {
            Ok(store) => {
                opened += 1;
                // A mutated description may promise more bricks than can be looked at one by one.
                for id in store.description().bricks().take(64) {
                    let _ = store.entry(id);
                    let _ = store.read_voxels(id);
                }
                if store.numbering().count() < 1000 {
                    let _ = look(&path);
                }
            }
            Err(_) => refused += 1,
        }
    }
    assert!(opened > rounds / 100 && refused > rounds / 100, "{opened} opened, {refused} refused");
}
