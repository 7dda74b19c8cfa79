//! Every file of the shared volumes against expected.json, whose figures another reader computed.

use std::path::Path;

use ashfall::import::{Header, Options, SegyFields, open, read_whole};
use ashfall::volume::{RawLayout, Size3, VoxelFormat, Voxels};
use serde_json::Value;
use sha2::{Digest, Sha256};

const BYTES_MAX: u64 = 256 << 20;

#[test]
fn every_shared_volume_gives_the_expected_voxels() {
    let Some(data) = crate::common::shared_data() else { return };
    let volumes = data.join("volumes");
    let text = std::fs::read_to_string(volumes.join("expected.json")).unwrap();
    let expected: serde_json::Map<String, Value> = serde_json::from_str(&text).unwrap();
    let mut checked = 0;
    let mut wrong = Vec::new();
    for (name, expected) in &expected {
        // Zarr is no format of import's.
        if !name.starts_with("zarr/") {
            checked += 1;
            if let Err(why) = check(&volumes.join(name), expected) {
                wrong.push(format!("{name}: {why}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{} of {checked} are wrong:\n{}", wrong.len(), wrong.join("\n"));
    assert_eq!(checked, 34, "files of expected.json that were checked");
}

fn check(path: &Path, expected: &Value) -> Result<(), String> {
    let mut options = Options { raw: raw_layout(path, expected), ..Options::default() };
    if let Some(inline) = expected["iline_byte"].as_u64() {
        let crossline = expected["xline_byte"].as_u64().unwrap();
        options.segy = SegyFields { inline_byte: inline as u16, crossline_byte: crossline as u16 };
    }
    let mut all = Figures::default();
    let mut times = 1;
    let mut header = None;
    while options.time < times {
        let mut input = open(path, &options).map_err(|why| why.to_string())?;
        times = input.header().times;
        header = Some(input.header().clone());
        let channels: Vec<u32> = (0..input.header().channels).collect();
        let whole = read_whole(&mut *input, &channels, BYTES_MAX).map_err(|why| why.to_string())?;
        assert_eq!(input.next_run().unwrap(), None, "a run after the last");
        let stored = expected["dtype"].as_str().unwrap();
        let mut absent = 0;
        for channel in &whole.channels {
            assert_eq!(channel.voxels.format(), input.header().format);
            absent += all.add(&channel.voxels, stored)?;
        }
        if absent != input.header().absent_voxels {
            return Err(format!("{absent} absent voxels, header says otherwise"));
        }
        options.time += 1;
    }
    let header = header.expect("opened at least once");
    check_header(&header, expected)?;
    all.check(expected)
}

fn raw_layout(path: &Path, expected: &Value) -> Option<RawLayout> {
    let edge = |axis: usize| expected["dims"][axis].as_u64().unwrap() as u32;
    path.to_string_lossy().contains(".raw.").then(|| RawLayout {
        size: Size3::new(edge(0), edge(1), edge(2)),
        format: VoxelFormat::U8,
        big_endian: false,
    })
}

fn check_header(header: &Header, expected: &Value) -> Result<(), String> {
    let equal = |what: &str, got: u64, want: &Value| match want.as_u64() {
        Some(want) if want != got => Err(format!("{what} is {got}, not {want}")),
        _ => Ok(()),
    };
    for (axis, edge) in header.size.to_array().into_iter().enumerate() {
        equal("size", edge.into(), &expected["dims"][axis])?;
    }
    equal("channels", header.channels.into(), &expected["channels"])?;
    equal("time steps", header.times.into(), &expected["timepoints"])?;
    if let Some(missing) = expected["missing_traces"].as_u64() {
        let samples = expected["samples"].as_u64().unwrap();
        equal("absent voxels", header.absent_voxels, &Value::from(missing * samples))?;
    }
    let close = |what: &str, got: f64, want: f64| {
        if (got - want).abs() <= 1e-6 * want.abs().max(1.0) {
            return Ok(());
        }
        Err(format!("{what} is {got}, not {want}"))
    };
    for (field, at) in [("slope", 0), ("inter", 1)] {
        if let Some(want) = expected[field].as_f64() {
            let scaling = header.scaling[0];
            close(field, [scaling.0, scaling.1][at], want)?;
        }
    }
    let rows = header.world_from_voxel.rows();
    for (row, got) in rows.iter().enumerate() {
        // Files' affines are of voxel centres, ours start at a corner.
        let half = 0.5 * (got[0] + got[1] + got[2]);
        let want_at = |column: usize| -> Option<f64> { expected["affine"][row][column].as_f64() };
        if want_at(0).is_some() {
            for (column, got) in got[..3].iter().enumerate() {
                close("affine", *got, want_at(column).unwrap())?;
            }
            close("affine origin", got[3] + half, want_at(3).unwrap())?;
        } else if let Some(spacing) = expected["spacing"][row].as_f64() {
            close("spacing", got[row], spacing)?;
        }
        if let Some(origin) = expected["origin"][row].as_f64() {
            close("origin", got[3] + half, origin)?;
        }
    }
    match expected["unit"].as_str() {
        Some(want) if header.unit.as_deref() != Some(&want.replace("\\u00B5", "\u{b5}")) => {
            Err(format!("unit is {:?}, not {want}", header.unit))
        }
        _ => Ok(()),
    }
}

struct Figures {
    hash: Sha256,
    least: f64,
    greatest: f64,
    sum: f64,
    count: f64,
}

impl Default for Figures {
    fn default() -> Figures {
        let (least, greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        Figures { hash: Sha256::new(), least, greatest, sum: 0.0, count: 0.0 }
    }
}

impl Figures {
    /// Takes voxels as the file's own type, absent ones as 0 (as expected.json has them), and says
    /// how many were absent.
    fn add(&mut self, voxels: &Voxels, stored: &str) -> Result<u64, String> {
        let mut absent = 0;
        let mut bytes = Vec::new();
        match (voxels, stored) {
            (Voxels::U8(v), "uint8") => bytes.extend_from_slice(v),
            (Voxels::U16(v), "uint16") => bytes.extend(v.iter().flat_map(|v| v.to_le_bytes())),
            (Voxels::I16(v), "int16") => bytes.extend(v.iter().flat_map(|v| v.to_le_bytes())),
            // Widened by import; the file's own bytes are had back by narrowing.
            (Voxels::I16(v), "int8") => bytes.extend(v.iter().map(|v| *v as i8 as u8)),
            (Voxels::F32(v), "float32") => {
                for value in v {
                    absent += u64::from(value.is_nan());
                    let value = if value.is_nan() { 0.0 } else { *value };
                    bytes.extend(value.to_le_bytes());
                }
            }
            (voxels, stored) => {
                return Err(format!("{stored} is delivered as {}", voxels.format()));
            }
        }
        self.hash.update(&bytes);
        for index in 0..voxels.len() {
            let value = f64::from(voxels.value(index));
            let value = if value.is_nan() { 0.0 } else { value };
            self.least = self.least.min(value);
            self.greatest = self.greatest.max(value);
            self.sum += value;
            self.count += 1.0;
        }
        Ok(absent)
    }

    fn check(self, expected: &Value) -> Result<(), String> {
        for (what, got) in
            [("min", self.least), ("max", self.greatest), ("mean", self.sum / self.count)]
        {
            let want = expected[what].as_f64().unwrap();
            if (got - want).abs() > 1e-9 * want.abs().max(1e-3) {
                return Err(format!("{what} is {got}, not {want}"));
            }
        }
        let hash: String = self.hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        let want = expected["sha256_voxels"].as_str().unwrap();
        if hash != want { Err(format!("voxels hash to {hash}, not {want}")) } else { Ok(()) }
    }
}
