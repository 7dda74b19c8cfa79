//! The pictures of docs/VIEWER.md: `ASHFALL_DOCS=docs/pictures cargo test --release --test viewer pictures -- --ignored`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::desktop::{Desktop, Shot};
use crate::folder::Folder;
use crate::window::view;

fn write_png(shot: &Shot, path: &Path) {
    let file = std::io::BufWriter::new(std::fs::File::create(path).expect("a file"));
    let mut encoder = png::Encoder::new(file, shot.size[0], shot.size[1]);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(shot.pixels.as_flattened()).expect("pixels");
    writer.finish().expect("an end");
}

/// A window of a scene on a desktop of its own size, once it has come to rest.
fn picture_of(scene: &str, size: [u32; 2], more: &[&str]) -> Shot {
    let desktop = Desktop::start([size[0] as u16 + 300, size[1] as u16]);
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/demo_scenes").join(scene);
    let mut child = view(&scene, &desktop.display, size).args(more).spawn().expect("it runs");
    let window = desktop.window(".toml");
    let shot = desktop.still(Duration::from_secs(6));
    desktop.close(window);
    assert!(child.wait().expect("an end").success());
    shot
}

#[test]
#[ignore = "a minute: the pictures of the docs, into ASHFALL_DOCS if that is set"]
fn pictures_of_the_docs() {
    let folder = Folder::new("pictures");
    let to = std::env::var_os("ASHFALL_DOCS").map(PathBuf::from);
    let to = to.map(|to| Path::new(env!("CARGO_MANIFEST_DIR")).join(to));
    let to = to.unwrap_or_else(|| folder.path(""));
    let shot = picture_of("mandelbulb.toml", [700, 860], &[]);
    // The panels are there, and a picture beside them.
    assert!(shot.part([0, 0], [700, 860]).covered() > 50_000);
    assert!(shot.part([700, 0], [300, 860]).covered() > 100_000);
    write_png(&shot, &to.join("viewer.png"));
    let all = picture_of("mandelbulb.toml", [500, 2040], &["--panels", "all"]);
    write_png(&all.part([500, 0], [300, 2040]), &to.join("viewer_panels.png"));
    write_png(&wall(&folder), &to.join("viewer_wall.png"));
}

/// A wall of three screens, one of them upright and one aslant, and the window to steer with.
fn wall(folder: &Folder) -> Shot {
    let text = r#"
format = 1
units = "metres"
eye = [0.0, 0.0, 2.0]
screen = [
    { name = "left", size = [210, 240], corners = [[-0.6, 0.4, 0.0], [0.1, 0.4, 0.0], [-0.6, -0.4, 0.0]], window = [320, 20] },
    { name = "upright", size = [240, 75], rotation = 90, corners = [[0.1, 0.4, 0.0], [0.35, 0.4, 0.0], [0.1, -0.4, 0.0]], window = [320, 280] },
    { name = "aslant", size = [75, 240], corners = [[0.35, 0.4, 0.0], [0.55, 0.4, 0.15], [0.35, -0.4, 0.0]], window = [540, 20] },
]
"#;
    let file = folder.write("wall.toml", text);
    let desktop = Desktop::start([640, 380]);
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/demo_scenes/shells.toml");
    let mut child = view(&scene, &desktop.display, [300, 380])
        .args(["--panels", "none", "--wall"])
        .arg(&file)
        .spawn()
        .expect("it runs");
    let window = desktop.window(".toml");
    for name in ["left", "upright", "aslant"] {
        desktop.window(name);
    }
    let shot = desktop.still(Duration::from_secs(4));
    desktop.close(window);
    assert!(child.wait().expect("an end").success());
    shot
}
