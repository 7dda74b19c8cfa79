//! Pictures for two eyes: each is the mono picture from where it is, byte for byte, also far off the axis, and
//! both share one atlas.

use ashfall::render::{Addressing, Picture, SceneData, Settings};
use ashfall::scene::{Overrides, Stereo};

use crate::binary::ashfall;
use crate::common::drawing::{Device, computed_scene};
use crate::folder::Folder;
use crate::scene::{SCENE, read, render};

fn mono(size: [u32; 2]) -> SceneData {
    let overrides = Overrides { size: Some(size), level_max: Some(0), ..Overrides::default() };
    let mut data = computed_scene("shells", [80; 3], &overrides);
    data.scene.views.truncate(1);
    data
}

fn paged() -> Settings {
    Settings { addressing: Addressing::Paged, ..Settings::default() }
}

#[test]
fn an_eye_far_off_the_axis_sees_the_same_in_pages_as_directly() {
    let Some(device) = Device::open() else { return };
    for separation in [0.1, 1.5, 4.0] {
        let mut data = mono([90, 60]);
        let stereo = Stereo { separation, distance: 1.6 };
        let eyes = stereo.eyes(&data.scene.views[0], [90, 60]).expect("eyes");
        data.scene.views = eyes.to_vec();
        let mut seen = Vec::new();
        for (view, eye) in eyes.iter().enumerate() {
            let direct = device.draw_with(&data, view, &Settings::default()).picture;
            let pages = device.draw_with(&data, view, &paged()).picture;
            assert!(direct == pages, "separation {separation}, view {view}");
            // Alone, without the other eye.
            let mut alone = mono([90, 60]);
            alone.scene.views = vec![eye.clone()];
            assert!(device.draw_with(&alone, 0, &paged()).picture == pages);
            seen.push(direct);
        }
        let covered = |of: &Picture| of.pixels.iter().filter(|pixel| pixel[3] > 0.01).count();
        assert!(covered(&seen[0]) > 100 && covered(&seen[1]) > 100, "separation {separation}");
        assert!(seen[0] != seen[1]);
    }
    device.finish();
}

#[test]
fn joined_pictures_are_those_of_both_eyes() {
    if std::env::var_os("ASHFALL_NO_DEVICE").is_some() {
        return;
    }
    let folder = Folder::new("stereo");
    let scene = folder.write("scene.toml", SCENE);
    let eyes = ["--eye-separation", "0.2", "--screen-distance", "2"];
    let with = |how: &'static str| {
        [&["--size", "100x70", "--addressing", "paged", "--stereo", how][..], &eyes].concat()
    };
    let pair = render(&folder, &scene, "eye.exr", &with("pair"));
    assert_eq!(pair["views"][1]["view"], "front-right");
    let [left, right] = ["eye-front-left.exr", "eye-front-right.exr"].map(|eye| read(&folder, eye));
    assert!(left != right && left.size == [100, 70]);
    let wide = render(&folder, &scene, "wide.exr", &with("side-by-side"));
    let wide_picture = read(&folder, "wide.exr");
    assert_eq!(wide_picture.size, [200, 70]);
    for (y, row) in wide_picture.pixels.chunks_exact(200).enumerate() {
        assert!(row[..100] == left.pixels[100 * y..][..100], "row {y}, left");
        assert!(row[100..] == right.pixels[100 * y..][..100], "row {y}, right");
    }
    render(&folder, &scene, "high.exr", &with("top-bottom"));
    let high = read(&folder, "high.exr");
    assert!(high.pixels[..7000] == left.pixels[..] && high.pixels[7000..] == right.pixels[..]);
    render(&folder, &scene, "red.exr", &with("anaglyph"));
    for (got, (left, right)) in
        read(&folder, "red.exr").pixels.iter().zip(left.pixels.iter().zip(&right.pixels))
    {
        assert_eq!(got[..3], [left[0], right[1], right[2]]);
    }
    // What both see is loaded once.
    let view = &wide["views"][0];
    let uploaded = |of: &serde_json::Value| of["bricks_uploaded"].as_u64().expect("a count");
    let (first, second) = (uploaded(view), uploaded(&view["right_eye"]));
    println!("{first} bricks for the left eye, {second} more for the right");
    assert!(first > 10 && second * 4 < first, "{first} and {second}");
}

#[test]
fn what_has_no_eyes_is_refused() {
    let folder = Folder::new("stereo");
    let scene = folder.write("scene.toml", SCENE);
    let flat = folder.write("flat.toml", SCENE.replace("fov_degrees = 40.0", "height = 1.5"));
    for (scene, flags, words) in [
        (&flat, &["--stereo", "pair"][..], "parallel rays"),
        (&scene, &["--stereo", "cross"], "side-by-side"),
        (&scene, &["--stereo", "pair", "--eye-separation", "0"], "above 0"),
        (&scene, &["--stereo", "pair", "--screen-distance", "inf"], "above 0"),
        (&scene, &["--eye-separation", "1"], "--stereo"),
        (&scene, &["--stereo", "anaglyph", "--error"], "--stereo pair"),
    ] {
        let arguments = ["render".as_ref(), scene.as_os_str()];
        let run = ashfall(arguments.into_iter().chain(flags.iter().map(AsRef::as_ref)));
        assert_eq!(run.code, Some(2), "{flags:?}: {}", run.stderr);
        assert!(run.stderr.contains(words), "{flags:?}: {}", run.stderr);
    }
}
