//! Peak memory of an import against the volume's size: each import is a process of its own.

use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::cli::bench::store::{Arguments, Folder, data};
use crate::error::{Error, Result};

/// Runs this program and reads the JSON it prints.
pub fn run_self(arguments: &[&str]) -> Result<Value> {
    let fail = |why: String| Error::machine(format!("cannot run this program again: {why}"));
    let program = std::env::current_exe().map_err(|why| fail(why.to_string()))?;
    let output = Command::new(program)
        .args(arguments)
        .stderr(Stdio::inherit())
        .output()
        .map_err(|why| fail(why.to_string()))?;
    serde_json::from_slice(&output.stdout).map_err(|why| fail(why.to_string()))
}

/// The part `memory`: volumes of one, two, four and eight times the slices, within 256 MiB; then
/// slices that do not fit 64 MiB, so that they are kept on disk.
pub fn against_size(arguments: &Arguments, folder: &Folder) -> Result<Value> {
    let edge = arguments.edge;
    let mut rows = Vec::new();
    for (slices, ram_mib) in
        [(edge / 4, 256), (edge / 2, 256), (edge, 256), (edge * 2, 256), (edge / 4, 64), (edge, 64)]
    {
        let input = data::raw_file(folder, edge, slices)?;
        let size = format!("{edge}x{edge}x{slices}");
        let output = folder.0.join("memory.bricks");
        let [input_text, output] = [&input, &output].map(|path| path.display().to_string());
        let ram = ram_mib.to_string();
        let made = run_self(&[
            "import",
            &input_text,
            "-o",
            &output,
            "--raw-size",
            &size,
            "--raw-type",
            "u8",
            "--ram-mib",
            &ram,
            "--json",
        ])?;
        rows.push(json!({
            "size": [edge, edge, slices], "voxel_mib": made["voxel_bytes"].as_f64().map(|b| b / 1048576.0),
            "ram_mib": ram_mib,
            "peak_rss_mib": made["peak_rss_bytes"].as_f64().map(|b| b / 1048576.0),
            "mib_per_second": made["mib_per_second"],
        }));
        let _ = std::fs::remove_file(&input);
    }
    Ok(Value::Array(rows))
}
