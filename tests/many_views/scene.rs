//! The scene of these tests, and pictures of it.

use std::path::Path;

use ashfall::render::Picture;

use crate::binary::ashfall;
use crate::folder::Folder;

pub const SCENE: &str = r#"
format = 1
[[volume]]
name = "shells"
source = { computed = "shells", size = [96, 96, 96] }
spacing = [0.01, 0.01, 0.01]
[[volume.channel]]
window = [0.0, 1.0]
transfer = [{ at = 0.2, color = [0.2, 0.7, 0.4], extinction = 0.0 }, { at = 1.0, color = [1.0, 0.8, 0.3], extinction = 12.0 }]
[[view]]
name = "front"
eye = [1.9, -1.2, 1.3]
target = [0.48, 0.48, 0.48]
up = [0.0, 0.0, 1.0]
fov_degrees = 40.0
"#;

pub fn render(folder: &Folder, scene: &Path, name: &str, flags: &[&str]) -> serde_json::Value {
    let output = folder.path(name);
    let fixed = ["--validate", "--json"];
    let run = ashfall(
        ["render".into(), scene.as_os_str().to_owned(), "-o".into(), output.into()]
            .into_iter()
            .chain(fixed.iter().chain(flags).map(Into::into)),
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    serde_json::from_str(&run.stdout).expect("JSON")
}

pub fn read(folder: &Folder, name: &str) -> Picture {
    ashfall::cli::read_exr(&folder.path(name)).unwrap_or_else(|why| panic!("{why}"))
}
