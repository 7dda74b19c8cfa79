//! A volume of 64 GiB that is nowhere: its bricks are computed when they are asked for.

use crate::alone;
use crate::common::drawing::Device;
use crate::drawn::Drawn;
use crate::folder::Folder;

const SCENE: &str = r#"format = 1
[picture]
size = [512, 512]
[memory]
atlas_mib = 256
ram_mib = 256
[[volume]]
name = "mandelbulb"
source = { computed = "mandelbulb", size = [4096, 4096, 4096] }
spacing = [0.000244140625, 0.000244140625, 0.000244140625]
[[volume.channel]]
window = [0.0, 255.0]
transfer = [
  { at = 0.0, color = [0.1, 0.2, 0.8], extinction = 0.0 },
  { at = 0.3, color = [0.2, 0.7, 0.4], extinction = 0.0 },
  { at = 0.5, color = [0.9, 0.6, 0.2], extinction = 60.0 },
  { at = 1.0, color = [1.0, 0.9, 0.8], extinction = 300.0 },
]
[[view]]
name = "whole"
eye = [1.8, -0.9, 1.3]
target = [0.5, 0.5, 0.5]
up = [0.0, 0.0, 1.0]
fov_degrees = 38.0
[[view]]
name = "inside"
eye = [0.86, 0.14, 0.8]
target = [0.5, 0.5, 0.52]
up = [0.0, 0.0, 1.0]
fov_degrees = 60.0
"#;

fn draw(view: &str, flags: &[&str]) -> Drawn {
    let folder = Folder::new(&format!("mandelbulb-{view}"));
    let drawn = Drawn::of(&folder.write("mandelbulb.toml", SCENE), view, flags);
    drawn.check();
    println!("mandelbulb of 64 GiB, {view} {}: {}", flags.join(" "), drawn.figures());
    drawn
}

#[test]
fn mandelbulb_of_64_gib_small() {
    let _alone = alone();
    if Device::open().is_some() {
        draw("whole", &["--size", "128x128"]);
    }
}

#[test]
#[ignore = "2 to 5 minutes: some 20,000 bricks of level 0 are computed and drawn"]
fn mandelbulb_of_64_gib_whole_and_from_inside() {
    let _alone = alone();
    if Device::open().is_some() {
        draw("whole", &[]);
        let drawn = draw("inside", &["--level-max", "0"]);
        assert_eq!(drawn.by_level()[0], drawn.number("bricks_uploaded"), "all of level 0");
    }
}
