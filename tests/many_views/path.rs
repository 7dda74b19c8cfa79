//! The frames of a path: as many as asked for, through the views, and the same bytes as each would have alone,
//! also where one renderer cannot be planned for all of them.

use crate::binary::ashfall;
use crate::folder::Folder;
use crate::scene::{SCENE, read, render};

fn scene_of_two_views() -> String {
    format!(
        "{SCENE}[[view]]\nname = \"side\"\neye = [2.2, 0.6, 0.2]\ntarget = [0.48, 0.48, 0.48]\nup = [0.0, 0.0, 1.0]\nfov_degrees = 30.0\n"
    )
}

#[test]
fn a_path_goes_from_view_to_view() {
    if std::env::var_os("ASHFALL_NO_DEVICE").is_some() {
        return;
    }
    let folder = Folder::new("path");
    let scene = folder.write("scene.toml", scene_of_two_views());
    let small = ["--size", "40x30", "--addressing", "paged"];
    render(&folder, &scene, "view.exr", &small);
    let frames =
        render(&folder, &scene, "frame.exr", &[&small[..], &["--path", "--frames", "5"]].concat());
    let frames = frames["views"].as_array().expect("views");
    assert_eq!(frames.len(), 5);
    assert_eq!(frames[3]["view"], "0003");
    assert!(frames.iter().all(|frame| frame["converged"] == true));
    // Cameras are equal to some 1e-15: few pixels fall on another side of a rounding.
    for (frame, view) in [("frame-0000.exr", "view-front.exr"), ("frame-0004.exr", "view-side.exr")]
    {
        let (frame, view) = (read(&folder, frame), read(&folder, view));
        let pairs = frame.pixels.as_flattened().iter().zip(view.pixels.as_flattened());
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-4, "{off}");
    }
    assert!(read(&folder, "frame-0002.exr") != read(&folder, "frame-0000.exr"));
}

/// More frames than one renderer is planned for, in pages and directly.
#[test]
fn a_long_path_goes_on_with_what_is_loaded() {
    if std::env::var_os("ASHFALL_NO_DEVICE").is_some() {
        return;
    }
    let folder = Folder::new("path");
    let path = "[path]\nthrough = [\"front\", \"side\", \"front\"]\nframes = 131\nclosed = true\n";
    let scene = folder.write("scene.toml", format!("{}{path}", scene_of_two_views()));
    let small = |how| ["--size", "8x6", "--level-max", "0", "--addressing", how, "--path"];
    let paged = render(&folder, &scene, "paged.exr", &small("paged"));
    render(&folder, &scene, "direct.exr", &small("direct"));
    for frame in [0, 64, 127, 128, 130] {
        let [paged, direct] =
            ["paged", "direct"].map(|how| read(&folder, &format!("{how}-{frame:04}.exr")));
        assert!(paged == direct, "frame {frame}");
    }
    assert!(!folder.path("paged-0131.exr").exists());
    // Frames of the second plan find what those of the first have loaded.
    let frames = paged["views"].as_array().expect("views");
    let count = |from: usize, to: usize| -> u64 {
        frames[from..to].iter().map(|of| of["bricks_uploaded"].as_u64().expect("a count")).sum()
    };
    assert!(count(0, 128) > 10 && count(128, 131) == 0);
}

#[test]
fn what_is_no_path_is_refused() {
    let folder = Folder::new("path");
    let one = folder.write("one.toml", SCENE);
    let gone = format!("{}[path]\nthrough = [\"gone\"]\n", scene_of_two_views());
    let gone = folder.write("gone.toml", gone);
    let none = folder.write("none.toml", format!("{SCENE}[path]\nframes = 0\n"));
    for (scene, flags, code, words) in [
        (&one, &["--path"][..], 3, "at least two views"),
        (&one, &["--path", "--frames", "0"], 2, "1 to 100000"),
        (&one, &["--frames", "5"], 2, "--path"),
        (&gone, &[], 3, "gone.toml:23:12: the path goes through \"gone\""),
        (&none, &[], 3, "1 to 100000 frames"),
    ] {
        let arguments = ["render".as_ref(), scene.as_os_str()];
        let run = ashfall(arguments.into_iter().chain(flags.iter().map(AsRef::as_ref)));
        assert_eq!(run.code, Some(code), "{flags:?}: {}", run.stderr);
        assert!(run.stderr.contains(words), "{flags:?}: {}", run.stderr);
    }
}

/// Eleven views as of a display without glasses: what they share is loaded once, and what a view reads back does
/// not grow (gpu-paging-2019).
#[test]
fn eleven_views_load_little_more_than_one() {
    if std::env::var_os("ASHFALL_NO_DEVICE").is_some() {
        return;
    }
    let folder = Folder::new("path");
    let views = |from: f64, to: f64| {
        let view = |name: &str, aside: f64| {
            let eye = [1.9 + 0.6 * aside, -1.2 + 0.7 * aside, 1.3];
            format!(
                "[[view]]\nname = \"{name}\"\neye = {eye:?}\ntarget = [0.48, 0.48, 0.48]\nup = [0.0, 0.0, 1.0]\nfov_degrees = 40.0\n"
            )
        };
        let head = &SCENE[..SCENE.find("[[view]]").expect("a view")];
        format!("{head}{}{}", view("left", from), view("right", to))
    };
    let scene = folder.write("scene.toml", views(-0.25, 0.25));
    let flags =
        ["--size", "160x120", "--addressing", "paged", "--level-max", "0", "--path", "--frames"];
    let of = |frames: &'static str| {
        let results = render(&folder, &scene, "view.exr", &[&flags[..], &[frames]].concat());
        let views = results["views"].as_array().expect("views").clone();
        let count = |key: &str| -> Vec<u64> {
            views.iter().map(|view| view[key].as_u64().expect("a count")).collect()
        };
        (count("bricks_uploaded"), count("bytes_read_back"))
    };
    let (one, read_by_one) = of("1");
    let (eleven, read_by_eleven) = of("11");
    let (all, read) = (eleven.iter().sum::<u64>(), read_by_eleven.iter().sum::<u64>());
    println!(
        "bricks: one view {}, eleven {all}, {:.2} times; bytes read back: {} and {read}, {:.2} times, {read_by_eleven:?}",
        one[0],
        all as f64 / one[0] as f64,
        read_by_one[0],
        read as f64 / read_by_one[0] as f64
    );
    assert!(one[0] > 20 && all as f64 <= 1.5 * one[0] as f64, "{eleven:?}");
    assert!(read_by_eleven[1..].iter().all(|bytes| *bytes < read_by_one[0]));
}
