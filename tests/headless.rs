//! A build without the window has no crate of a window system in its tree.

use std::process::Command;

/// Crates that a program without arguments for cargo's features is built of.
fn crates(features: &[&str]) -> Vec<String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let output = Command::new(cargo)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["tree", "--locked", "--offline", "--edges", "normal", "--prefix", "none"])
        .args(["--format", "{p}"])
        .args(features)
        .output()
        .expect("cargo runs");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    assert!(output.status.success(), "{}", text(output.stderr));
    let name = |line: &str| line.split(' ').next().unwrap_or_default().to_owned();
    let mut crates: Vec<String> = text(output.stdout).lines().map(name).collect();
    crates.sort();
    crates.dedup();
    crates
}

#[test]
fn a_headless_build_has_no_windowing_crate() {
    let of_windows = |crates: &[String]| -> Vec<String> {
        let words = ["winit", "egui", "x11", "xkb", "wayland", "raw-window-handle", "ash-window"];
        let is = |name: &&String| words.iter().any(|word| name.contains(word));
        crates.iter().filter(is).cloned().collect()
    };
    let whole = crates(&[]);
    let headless = crates(&["--no-default-features"]);
    println!("{} crates, {} without the window", whole.len(), headless.len());
    assert!(of_windows(&whole).len() > 5, "{whole:?}");
    assert_eq!(of_windows(&headless), Vec::<String>::new());
    assert!(headless.iter().any(|name| name == "ash"), "the tree is what it should be");
    assert!(headless.len() < whole.len());
}
