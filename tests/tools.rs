//! What the scripts in tools/ say before they install or draw anything.

#![cfg(unix)]

use std::process::Command;

/// Exit code, stdout and stderr of `tools/compare-vtk arguments`.
fn compare_vtk(arguments: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new("bash");
    command.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tools/compare-vtk"));
    let output =
        command.args(arguments).current_dir(std::env::temp_dir()).output().expect("bash runs");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn compare_vtk_explains_itself() {
    let (code, stdout, stderr) = compare_vtk(&["--help"]);
    assert_eq!((code, stderr.as_str()), (Some(0), ""));
    for word in ["SCENE", "--size", "--view", "--output", "--repeats", "--json", "--with"] {
        assert!(stdout.contains(word), "--help lacks {word}");
    }
    for word in ["--binary", "--device", "Ends with 0"] {
        assert!(stdout.contains(word), "--help lacks {word}");
    }
}

#[test]
fn compare_vtk_refuses_in_one_sentence() {
    let refused: [(&[&str], i32, &str); 8] = [
        (&[], 2, "a scene is missing"),
        (&["a.toml", "b.toml"], 2, "one scene at a time"),
        (&["a.toml", "--size"], 2, "--size needs a value"),
        (&["a.toml", "--size", "0x5"], 2, "expected WxH"),
        (&["a.toml", "--repeats", "0"], 2, "--repeats"),
        (&["a.toml", "--with"], 2, "--with needs a value"),
        (&["a.toml", "--unknown"], 2, "unknown argument --unknown"),
        (&["not-there.toml"], 3, "not-there.toml: is no file"),
    ];
    for (arguments, code, words) in refused {
        let (ended, stdout, stderr) = compare_vtk(arguments);
        assert_eq!((ended, stdout.as_str()), (Some(code), ""), "{arguments:?}: {stderr}");
        assert!(stderr.starts_with("compare-vtk: ") && stderr.contains(words), "{stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
    }
}
