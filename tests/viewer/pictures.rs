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

#[test]
#[ignore = "half a minute: the pictures of the docs, into ASHFALL_DOCS if that is set"]
fn pictures_of_the_docs() {
    let folder = Folder::new("pictures");
    let to = std::env::var_os("ASHFALL_DOCS").map(PathBuf::from);
    let to = to.map(|to| Path::new(env!("CARGO_MANIFEST_DIR")).join(to));
    let desktop = Desktop::start([990, 640]);
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/demo_scenes/mandelbulb.toml");
    let mut child = view(&scene, &desktop.display, [700, 640]).spawn().expect("the binary runs");
    let window = desktop.window("mandelbulb.toml");
    let shot = desktop.still(Duration::from_secs(4));
    desktop.close(window);
    assert!(child.wait().expect("an end").success());
    // The panels are there, and a picture beside them.
    assert!(shot.part([0, 0], [700, 640]).covered() > 50_000);
    assert!(shot.part([700, 0], [290, 640]).covered() > 100_000);
    write_png(&shot, &to.unwrap_or_else(|| folder.path("")).join("viewer.png"));
}
