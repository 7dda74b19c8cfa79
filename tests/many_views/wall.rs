//! Screens of a wall: put together they are one large picture, byte for byte, however they hang; what two of
//! them see is loaded once; what is far off the axis is neither left out nor loaded in vain.

use ashfall::render::Picture;
use ashfall::scene::Wall;

use crate::binary::ashfall;
use crate::folder::Folder;
use crate::scene::{SCENE, read, render};

/// Rows and columns of two screens each, as `SCENE`'s view "front" sees them: 160 by 112 pixels in all.
const SIZES: [[u32; 4]; 2] = [[0, 70, 0, 64], [70, 90, 64, 48]];
const WHOLE: [u32; 2] = [160, 112];

fn corner(column: u32, row: u32) -> [f64; 3] {
    // A perspective of 40 degrees, at distance 1.
    let top = 20.0f64.to_radians().tan();
    let right = top * f64::from(WHOLE[0]) / f64::from(WHOLE[1]);
    let part = |at: u32, of: u32| 2.0 * f64::from(at) / f64::from(of) - 1.0;
    [part(column, WHOLE[0]) * right, -part(row, WHOLE[1]) * top, -1.0]
}

/// A screen that shows these pixels of the whole picture, and hangs by so many quarter turns.
fn screen(name: &str, [left, width, top, height]: [u32; 4], turns: u32, more: &str) -> String {
    let corners =
        [[left, top], [left + width, top], [left, top + height]].map(|[x, y]| corner(x, y));
    let own = if turns.is_multiple_of(2) { [width, height] } else { [height, width] };
    let rotation = 90 * turns;
    format!(
        "[[screen]]\nname = \"{name}\"\nsize = {own:?}\ncorners = {corners:?}\nrotation = {rotation}\n{more}\n"
    )
}

fn wall(screens: &[String]) -> String {
    format!("format = 1\nunits = \"metres\"\neye = [0.0, 0.0, 0.0]\n{}", screens.concat())
}

/// Left, width, top and height of the four screens.
fn quarters() -> [[u32; 4]; 4] {
    let of = |x: usize, y: usize| [SIZES[x][0], SIZES[x][1], SIZES[y][2], SIZES[y][3]];
    [of(0, 0), of(1, 0), of(0, 1), of(1, 1)]
}

/// What is seen of a screen that is given `own`: pixel by pixel, by where its own right and down point to.
fn seen(own: &Picture, turns: u32, [width, height]: [u32; 2]) -> Vec<[f32; 4]> {
    let at = |x: u32, y: u32| own.pixels[(y * own.size[0] + x) as usize];
    let pixel = |column: u32, row: u32| match turns {
        0 => at(column, row),
        1 => at(row, width - 1 - column),
        2 => at(width - 1 - column, height - 1 - row),
        _ => at(height - 1 - row, column),
    };
    (0..height).flat_map(|row| (0..width).map(move |column| pixel(column, row))).collect()
}

fn no_device() -> bool {
    std::env::var_os("ASHFALL_NO_DEVICE").is_some()
}

#[test]
fn screens_put_together_are_one_picture_byte_for_byte() {
    if no_device() {
        return;
    }
    let folder = Folder::new("wall");
    let scene = folder.write("scene.toml", SCENE);
    for (addressing, turns) in
        [("direct", [0; 4]), ("paged", [0; 4]), ("paged", [1, 2, 3, 0]), ("direct", [3, 3, 1, 2])]
    {
        let flags = ["--addressing", addressing];
        let whole =
            render(&folder, &scene, "whole.exr", &[&flags[..], &["--size", "160x112"]].concat());
        let names = ["a", "b", "c", "d"];
        let screens: Vec<String> =
            (0..4).map(|at| screen(names[at], quarters()[at], turns[at], "")).collect();
        let file = folder.write("wall.toml", wall(&screens));
        let file = file.to_str().expect("UTF-8");
        let tiles = render(&folder, &scene, "tile.exr", &[&flags[..], &["--wall", file]].concat());
        // As one screen, too.
        let one = wall(&[screen("one", [0, WHOLE[0], 0, WHOLE[1]], 0, "")]);
        let one = folder.write("one.toml", one);
        let one = one.to_str().expect("UTF-8");
        render(&folder, &scene, "one.exr", &[&flags[..], &["--wall", one]].concat());
        let picture = read(&folder, "whole.exr");
        assert!(read(&folder, "one.exr") == picture, "{addressing}: a wall of one screen");
        for ((name, [left, width, top, height]), turns) in names.iter().zip(quarters()).zip(turns) {
            let tile = read(&folder, &format!("tile-{name}.exr"));
            let rows = picture.pixels.chunks_exact(WHOLE[0] as usize).skip(top as usize);
            let rows =
                rows.take(height as usize).map(|row| &row[left as usize..][..width as usize]);
            let part = rows.collect::<Vec<_>>().concat();
            assert!(
                seen(&tile, turns, [width, height]) == part,
                "{addressing}: screen {name} turned {turns}"
            );
        }
        if addressing == "paged" {
            let count = |of: &serde_json::Value| of["bricks_uploaded"].as_u64().expect("a count");
            let views = tiles["views"].as_array().expect("views");
            let of_tiles: u64 = views.iter().map(count).sum();
            let of_whole = count(&whole["views"][0]);
            println!("four screens {of_tiles} bricks, one picture {of_whole}");
            assert!(of_whole > 10 && of_tiles == of_whole);
        }
    }
}

/// The walls of a room around an eye inside the volume, off its middle, close to the left one.
const ROOM: &str = r#"
format = 1
eye = [0.11, 0.43, 0.5]
screen = [
    { name = "ahead", size = [80, 60], corners = [[0.1, 0.9, 0.8], [0.9, 0.9, 0.8], [0.1, 0.9, 0.2]] },
    { name = "left", size = [80, 60], corners = [[0.1, 0.1, 0.8], [0.1, 0.9, 0.8], [0.1, 0.1, 0.2]] },
    { name = "right", size = [80, 60], corners = [[0.9, 0.9, 0.8], [0.9, 0.1, 0.8], [0.9, 0.9, 0.2]] },
    { name = "floor", size = [80, 80], corners = [[0.1, 0.9, 0.2], [0.9, 0.9, 0.2], [0.1, 0.1, 0.2]] },
]
"#;

/// An eye outside: one screen lies beside it, up to 84 degrees off its axis, and one looks away.
const ASIDE: &str = r#"
format = 1
eye = [2.0, -0.8, 0.5]
screen = [
    { name = "edge", size = [180, 80], corners = [[1.0, -0.7, 0.7], [1.9, -0.7, 0.7], [1.0, -0.7, 0.3]] },
    { name = "away", size = [80, 32], corners = [[3.0, -0.9, 0.9], [1.0, -0.9, 0.9], [3.0, -0.9, 0.1]] },
]
"#;

/// Screens beside the eye, nearly along their planes: in pages and directly the same bytes, from every screen,
/// and no bricks for one that sees nothing.
#[test]
fn screens_far_off_the_axis_see_what_is_there() {
    if no_device() {
        return;
    }
    let folder = Folder::new("wall");
    let scene = folder.write("scene.toml", SCENE);
    for (text, least) in [(ROOM, &[1000, 1000, 1000, 1000][..]), (ASIDE, &[150, 0])] {
        let file = folder.write("wall.toml", text);
        let file = file.to_str().expect("UTF-8");
        let wall = Wall::load(file.as_ref()).unwrap_or_else(|why| panic!("{why}"));
        let with = |how: &str| {
            let flags = ["--level-max", "0", "--addressing", how, "--wall", file];
            render(&folder, &scene, &format!("{how}.exr"), &flags)
        };
        with("direct");
        let paged = with("paged");
        for ((screen, least), view) in
            wall.screens.iter().zip(least).zip(paged["views"].as_array().expect("views"))
        {
            let name = &screen.name;
            let [direct, paged] =
                ["direct", "paged"].map(|how| read(&folder, &format!("{how}-{name}.exr")));
            assert!(direct == paged, "{name}");
            let covered = direct.pixels.iter().filter(|pixel| pixel[3] > 0.01).count();
            println!("{name}: {covered} pixels, {} bricks", view["bricks_needed"]);
            assert!(covered >= *least, "{name}: {covered}");
            if *least == 0 {
                assert_eq!((covered, view["bricks_needed"].as_u64()), (0, Some(0)), "{name}");
            }
        }
    }
}

#[test]
fn light_of_overlapping_screens_adds_up_to_the_picture() {
    if no_device() {
        return;
    }
    let folder = Folder::new("wall");
    let scene = folder.write("scene.toml", SCENE);
    render(&folder, &scene, "whole.exr", &["--size", "160x112"]);
    // Sixteen columns are on both.
    let screens = [
        screen("left", [0, 88, 0, 112], 0, "overlap = [0, 16, 0, 0]"),
        screen("right", [72, 88, 0, 112], 3, "overlap = [16, 0, 0, 0]"),
    ];
    let file = folder.write("wall.toml", wall(&screens));
    render(&folder, &scene, "tile.exr", &["--wall", file.to_str().expect("UTF-8")]);
    let left = seen(&read(&folder, "tile-left.exr"), 0, [88, 112]);
    let right = seen(&read(&folder, "tile-right.exr"), 3, [88, 112]);
    for (at, expected) in read(&folder, "whole.exr").pixels.iter().enumerate() {
        let (column, row) = (at % 160, at / 160);
        let mut sum = [0.0; 4];
        let mut add = |of: &[f32; 4]| sum.iter_mut().zip(of).for_each(|(sum, of)| *sum += of);
        if column < 88 {
            add(&left[88 * row + column]);
        }
        if column >= 72 {
            add(&right[88 * row + column - 72]);
        }
        for (sum, expected) in sum.iter().zip(expected) {
            assert!((sum - expected).abs() <= 1e-6 * expected.abs(), "{column}, {row}");
        }
    }
}

#[test]
fn what_a_wall_cannot_be_drawn_with_is_refused() {
    let folder = Folder::new("wall");
    let scene = folder.write("scene.toml", SCENE);
    let good = folder.write("wall.toml", wall(&[screen("a", quarters()[0], 0, "")]));
    let bad = folder.write("bad.toml", wall(&[screen("a", quarters()[0], 0, "gap = 3")]));
    let gone = folder.path("gone.toml");
    for (file, flags, code, words) in [
        (&good, &["--size", "9x9"][..], 2, "--size"),
        (&good, &["--stereo", "pair"], 2, "--stereo"),
        (&good, &["--path"], 2, "--path"),
        (&good, &["--error"], 2, "no wall"),
        (&bad, &[], 3, "bad.toml: line 9: unknown field"),
        (&gone, &[], 3, "gone.toml: cannot be read"),
    ] {
        let arguments = ["render".as_ref(), scene.as_os_str(), "--wall".as_ref(), file.as_os_str()];
        let run = ashfall(arguments.into_iter().chain(flags.iter().map(AsRef::as_ref)));
        assert_eq!(run.code, Some(code), "{flags:?}: {}", run.stderr);
        assert!(run.stderr.contains(words), "{flags:?}: {}", run.stderr);
    }
}
