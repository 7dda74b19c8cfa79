//! Printing results on stdout and remarks on stderr.

use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::path::Path;

use serde::Serialize;

use crate::error::{Error, Result};

/// Prints text: the one door to stdout. A reader that has gone away is no error, where `println!`
/// would panic.
///
/// # Errors
/// Exit code 4 when stdout takes no more, as a file on a full disk.
pub fn print(text: impl Display) -> Result<()> {
    printed(write!(std::io::stdout().lock(), "{text}"))
}

/// What became of a write to stdout, which may hold some of it back until now.
///
/// # Errors
/// As [`print`].
pub fn printed(written: std::io::Result<()>) -> Result<()> {
    match written.and_then(|()| std::io::stdout().flush()) {
        Err(why) if why.kind() != ErrorKind::BrokenPipe => Err(Error::machine(format!(
            "standard output: cannot be written: {why}; make room where it goes, or send it elsewhere"
        ))),
        _ => Ok(()),
    }
}

/// Prints a line of text, as [`print`].
///
/// # Errors
/// As [`print`].
pub fn print_line(text: impl Display) -> Result<()> {
    print(format_args!("{text}\n"))
}

/// Prints one object with `"format": 1` first.
///
/// # Errors
/// As [`print`].
pub fn print_json(value: &impl Serialize) -> Result<()> {
    print(json_text(value)?)
}

/// Says one line on stderr: the one door to it. Where stderr takes nothing there is nobody left to
/// tell, so that is no error, where `eprintln!` would panic.
pub fn say(text: impl Display) {
    let _ = writeln!(std::io::stderr().lock(), "ashfall: {text}");
}

/// Writes text into a file of the folder that `-o` names.
///
/// # Errors
/// Exit code 4 when the disk does not take it.
pub fn write(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).map_err(|why| not_written(path, &why))
}

/// Makes the folder that `-o` names, where it is not there.
///
/// # Errors
/// As [`write`].
pub fn make_folder(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|why| not_written(folder, &why))
}

fn not_written(path: &Path, why: &std::io::Error) -> Error {
    Error::machine(format!("{}: cannot be written: {why}; choose another -o", path.display()))
}

/// Writes such an object into a file.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    std::fs::write(path, json_text(value)?).map_err(|why| {
        Error::machine(format!(
            "{}: cannot be written: {why}; check folder and disk",
            path.display()
        ))
    })
}

#[derive(Serialize)]
struct WithFormat<'a, T> {
    format: u32,
    #[serde(flatten)]
    value: &'a T,
}

fn json_text(value: &impl Serialize) -> Result<String> {
    let mut text = serde_json::to_string_pretty(&WithFormat { format: 1, value })
        .map_err(|why| Error { exit: crate::error::Exit::Bug, message: why.to_string() })?;
    text.push('\n');
    Ok(text)
}
