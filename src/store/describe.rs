//! The description's bytes, both ways.

use crate::error::{Error, Result};
use crate::source::{ChannelDescription, Description};
use crate::store::layout::{
    CHANNEL_COUNT_MAX, LEVEL_COUNT_MAX, PAYLOAD_MAX, channel, description as fixed, level,
};
use crate::volume::{BRICK_APRON, Level, Levels, Size3, ValueRange, VoxelFormat, WorldFromVoxel};

fn code(format: VoxelFormat) -> u32 {
    VoxelFormat::ALL.iter().position(|&known| known == format).expect("ALL has all") as u32
}

/// The description as docs/FORMAT.md draws it.
pub fn to_bytes(description: &Description) -> Vec<u8> {
    let mut bytes = vec![0; fixed::BYTES];
    let unit = description.unit.as_deref().unwrap_or_default();
    let size = description.size();
    let numbers = [
        (fixed::SIZE_X, size.x),
        (fixed::SIZE_Y, size.y),
        (fixed::SIZE_Z, size.z),
        (fixed::PAYLOAD_X, description.payload.x),
        (fixed::PAYLOAD_Y, description.payload.y),
        (fixed::PAYLOAD_Z, description.payload.z),
        (fixed::CHANNEL_COUNT, description.channels.len() as u32),
        (fixed::LEVEL_COUNT, description.levels.count() as u32),
        (fixed::NAME_BYTES, description.name.len() as u32),
        (fixed::UNIT_BYTES, unit.len() as u32),
        (fixed::PROVENANCE_BYTES, description.provenance.len() as u32),
        (fixed::APRON, BRICK_APRON),
    ];
    for (field, number) in numbers {
        field.set(&mut bytes, &number.to_le_bytes());
    }
    let rows = description.world_from_voxel.rows();
    let transform: Vec<u8> = rows.iter().flatten().flat_map(|entry| entry.to_le_bytes()).collect();
    fixed::TRANSFORM.set(&mut bytes, &transform);
    for row in &description.channels {
        bytes.extend_from_slice(&channel_to_bytes(row));
    }
    for row in description.levels.iter() {
        let mut out = [0; level::BYTES];
        let fields = [level::SIZE_X, level::SIZE_Y, level::SIZE_Z];
        let scales = [level::SCALE_X, level::SCALE_Y, level::SCALE_Z];
        for axis in 0..3 {
            fields[axis].set(&mut out, &row.size.to_array()[axis].to_le_bytes());
            scales[axis].set(&mut out, &row.scale[axis].to_le_bytes());
        }
        bytes.extend_from_slice(&out);
    }
    for text in [&description.name, unit, &description.provenance] {
        bytes.extend_from_slice(text.as_bytes());
    }
    bytes
}

fn channel_to_bytes(row: &ChannelDescription) -> [u8; channel::BYTES] {
    let mut out = [0; channel::BYTES];
    channel::FORMAT.set(&mut out, &code(row.format).to_le_bytes());
    channel::SLOPE.set(&mut out, &row.slope.to_le_bytes());
    channel::INTERCEPT.set(&mut out, &row.intercept.to_le_bytes());
    channel::NAN_VOXELS.set(&mut out, &row.nan_voxels.to_le_bytes());
    channel::INFINITE_VOXELS.set(&mut out, &row.infinite_voxels.to_le_bytes());
    channel::ABSENT_VOXELS.set(&mut out, &row.absent_voxels.to_le_bytes());
    channel::LEAST.set(&mut out, &row.range.least.to_le_bytes());
    channel::GREATEST.set(&mut out, &row.range.greatest.to_le_bytes());
    out
}

/// From such bytes, every field checked; nothing is allocated beyond their length.
///
/// # Errors
/// Naming the field that makes no sense.
pub fn from_bytes(bytes: &[u8]) -> Result<Description> {
    let bad = |what: &str| Error::input(format!("its description is damaged: {what}"));
    if bytes.len() < fixed::BYTES {
        return Err(bad("it is too short"));
    }
    let (head, rest) = bytes.split_at(fixed::BYTES);
    let size3 = |fields: [_; 3]| {
        let [x, y, z] = fields.map(|field: crate::store::layout::Field| field.u32(head));
        Size3::new(x, y, z)
    };
    let size = size3([fixed::SIZE_X, fixed::SIZE_Y, fixed::SIZE_Z]);
    let payload = size3([fixed::PAYLOAD_X, fixed::PAYLOAD_Y, fixed::PAYLOAD_Z]);
    if size.is_empty() {
        return Err(bad("the volume has no voxels"));
    }
    if payload.to_array().iter().any(|edge| !(1..=PAYLOAD_MAX).contains(edge)) {
        return Err(bad("payload must be 1 to 256 voxels along each axis"));
    }
    if fixed::APRON.u32(head) != BRICK_APRON {
        return Err(bad("apron must be 1"));
    }
    let channels = fixed::CHANNEL_COUNT.u32(head);
    let levels = fixed::LEVEL_COUNT.u32(head);
    if !(1..=CHANNEL_COUNT_MAX).contains(&channels) {
        return Err(bad("channel_count must be 1 to 65535"));
    }
    if !(1..=LEVEL_COUNT_MAX).contains(&levels) {
        return Err(bad("level_count must be 1 to 64"));
    }
    let texts = [fixed::NAME_BYTES, fixed::UNIT_BYTES, fixed::PROVENANCE_BYTES]
        .map(|field| field.u32(head) as usize);
    let rows = channels as usize * channel::BYTES + levels as usize * level::BYTES;
    if rest.len() as u128 != rows as u128 + texts.iter().map(|&len| len as u128).sum::<u128>() {
        return Err(bad("its parts are not as long as it says"));
    }
    let (channel_rows, rest) = rest.split_at(channels as usize * channel::BYTES);
    let (level_rows, mut rest) = rest.split_at(levels as usize * level::BYTES);

    let channels = channel_rows
        .chunks_exact(channel::BYTES)
        .map(|row| channel_from_bytes(row).ok_or_else(|| bad("a channel makes no sense")))
        .collect::<Result<Vec<_>>>()?;
    let levels = level_rows.chunks_exact(level::BYTES).map(level_from_bytes).collect();
    let levels = Levels::from_list(levels, payload)
        .filter(|levels| levels.get(0).is_some_and(|finest| finest.size == size))
        .ok_or_else(|| bad("its levels are not halvings of the volume down to one brick"))?;

    let transform = fixed::TRANSFORM.of::<96>(head);
    let number = |i: usize| f64::from_le_bytes(std::array::from_fn(|byte| transform[i * 8 + byte]));
    let rows = std::array::from_fn(|row| std::array::from_fn(|column| number(row * 4 + column)));
    let world_from_voxel = WorldFromVoxel::from_rows(rows).map_err(|why| bad(&why.message))?;

    let mut text = |len: usize| {
        let (text, after) = rest.split_at(len);
        rest = after;
        String::from_utf8(text.to_vec()).map_err(|_| bad("a text is not UTF-8"))
    };
    let (name, unit, provenance) = (text(texts[0])?, text(texts[1])?, text(texts[2])?);
    Ok(Description {
        name,
        payload,
        levels,
        world_from_voxel,
        unit: Some(unit).filter(|unit| !unit.is_empty()),
        provenance,
        channels,
    })
}

fn channel_from_bytes(row: &[u8]) -> Option<ChannelDescription> {
    let description = ChannelDescription {
        format: *VoxelFormat::ALL.get(channel::FORMAT.u32(row) as usize)?,
        slope: channel::SLOPE.f64(row),
        intercept: channel::INTERCEPT.f64(row),
        nan_voxels: channel::NAN_VOXELS.u64(row),
        infinite_voxels: channel::INFINITE_VOXELS.u64(row),
        absent_voxels: channel::ABSENT_VOXELS.u64(row),
        range: ValueRange { least: channel::LEAST.f32(row), greatest: channel::GREATEST.f32(row) },
    };
    let finite = description.slope.is_finite() && description.intercept.is_finite();
    let range = description.range;
    let ranged = range.least <= range.greatest || range == ValueRange::EMPTY;
    (finite && ranged && channel::RESERVED.u32(row) == 0).then_some(description)
}

fn level_from_bytes(row: &[u8]) -> Level {
    Level {
        size: Size3::new(level::SIZE_X.u32(row), level::SIZE_Y.u32(row), level::SIZE_Z.u32(row)),
        scale: [level::SCALE_X, level::SCALE_Y, level::SCALE_Z].map(|field| field.u32(row)),
    }
}
