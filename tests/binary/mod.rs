//! The built binary as users meet it: run, with what it said.

// Each test file uses its own part of this.
#![allow(dead_code)]

use std::ffi::OsStr;
use std::process::{Command, Output};

/// How a run ended.
pub struct Run {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    /// What a process that ended left.
    pub fn of(output: Output) -> Run {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("output is UTF-8");
        Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    /// The one line on stderr, behind "ashfall: ".
    pub fn sentence(&self) -> Result<&str, String> {
        match self.stderr.lines().collect::<Vec<_>>()[..] {
            [line] => line
                .strip_prefix("ashfall: ")
                .ok_or_else(|| format!("does not begin with \"ashfall: \": {line}")),
            _ => Err(format!("not one line on stderr: {:?}", self.stderr)),
        }
    }
}

/// `ashfall arguments`.
pub fn ashfall<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ashfall"));
    // What a test lets slip must not be written into the repository.
    command.current_dir(std::env::temp_dir());
    Run::of(command.args(arguments).output().expect("the binary runs"))
}

/// `ashfall arguments` in an address space of so many KiB.
pub fn ashfall_within<S: AsRef<OsStr>>(kib: u64, arguments: impl IntoIterator<Item = S>) -> Run {
    let mut shell = Command::new("sh");
    shell.current_dir(std::env::temp_dir());
    shell.arg("-c").arg(format!("ulimit -v {kib}; exec \"$0\" \"$@\""));
    shell.arg(env!("CARGO_BIN_EXE_ashfall")).args(arguments);
    Run::of(shell.output().expect("the binary runs"))
}
