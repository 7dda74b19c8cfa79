//! What users get wrong in scenes and flags: each ends with one sentence that names place, thing and
//! remedy, and with the contract's exit code, before any device is opened.

mod binary;
mod folder;
#[path = "bad_scenes/levels.rs"]
mod levels;

use binary::{Run, ashfall, ashfall_within};
use folder::Folder;

/// A good scene; bad ones differ from it at one place.
const GOOD: &str = r#"format = 1
[picture]
size = [8, 8]
background = [0.0, 0.1, 0.2]
[quality]
integrator = "riemann"
step = 0.5
filter = "exact"
refine = "exact"
level_max = 0
early_stop = 0.0
[memory]
atlas_mib = 64
ram_mib = 1024
staging_mib = 2
[[volume]]
name = "ball"
source = { computed = "shells", size = [4, 4, 4] }
spacing = [1.0, 1.0, 1.0]
[[volume.channel]]
index = 0
window = [0.0, 255.0]
transfer = [
  { at = 0.0, color = [0.0, 0.0, 0.0], extinction = 0.0 },
  { at = 1.0, color = [1.0, 0.5, 0.25], extinction = 0.5 },
]
[[view]]
name = "front"
eye = [2.0, 2.0, -8.0]
target = [2.0, 2.0, 2.0]
up = [0.0, 1.0, 0.0]
fov_degrees = 40.0
"#;

const SPACING: &str = "spacing = [1.0, 1.0, 1.0]";
const SOURCE: &str = "source = { computed = \"shells\", size = [4, 4, 4] }";
const FIRST_POINT: &str = "  { at = 0.0, color = [0.0, 0.0, 0.0], extinction = 0.0 },";
const FOV: &str = "fov_degrees = 40.0";

/// What is replaced in [`GOOD`], by what, and what the sentence says. A `@` marks the place that the
/// sentence names and is not written.
type Bad = (&'static str, &'static str, &'static [&'static str]);

const FORMAT_AND_TABLES: &[Bad] = &[
    ("format = 1", "@#", &["format = 1", "missing"]),
    ("format = 1", "format = @2", &["format 2", "format 1"]),
    ("format = 1", "format = @\"1\"", &["format", "string", "expected i64"]),
    ("format = 1", "format = 1\n@shape = 3", &["shape", "`picture`"]),
    ("[picture]", "[@pictures]", &["pictures", "`picture`"]),
    ("[picture]\n", "[picture]\n@sizes = 3\n", &["sizes", "`size`"]),
    ("[quality]\n", "[quality]\n@steps = 3\n", &["steps", "`step`"]),
    ("[memory]\n", "[memory]\n@atlas = 3\n", &["atlas", "`atlas_mib`"]),
    ("name = \"ball\"", "@title = \"ball\"", &["title", "`name`"]),
    ("index = 0", "@number = 0", &["number", "`index`"]),
    ("{ at = 0.0,", "{ @place = 0.0,", &["place", "`at`"]),
    (FOV, "@fov = 40.0", &["fov", "`fov_degrees`"]),
    ("[[view]]", "@[view]", &["view", "[[view]]"]),
    ("[[volume.channel]]", "@[volume.channel]", &["volume.channel", "[[volume.channel]]"]),
    ("[[view]]", "[[view]@", &["expected `]`"]),
    ("step = 0.5", "step = 0.5\n@step = 0.25", &["step", "twice"]),
    ("name = \"ball\"", "name = \"ball@", &["expected `\"`"]),
    ("[picture]", "[picture", &["expected `]`"]),
];

const PICTURE_QUALITY_MEMORY: &[Bad] = &[
    ("size = [8, 8]", "size = @[0, 8]", &["size", "1 to 32768", "got 0 x 8"]),
    ("size = [8, 8]", "size = @[8, -8]", &["size", "1 to 32768", "got 8 x -8"]),
    ("size = [8, 8]", "size = @[8, 32769]", &["size", "1 to 32768"]),
    ("size = [8, 8]", "size = @[8]", &["size", "2"]),
    ("size = [8, 8]", "size = [@8.0, 8]", &["size", "i64"]),
    ("size = [8, 8]", "size = @8", &["size", "array"]),
    ("size = [8, 8]", "size = [@9223372036854775808, 8]", &["size"]),
    ("[0.0, 0.1, 0.2]", "@[0.0, -0.1, 0.2]", &["background", "negative"]),
    ("[0.0, 0.1, 0.2]", "@[0.0, 1e39, 0.2]", &["background", "finite"]),
    ("\"riemann\"", "@\"simpson\"", &["integrator", "simpson", "riemann"]),
    ("\"riemann\"", "@\"Adaptive\"", &["integrator", "riemann", "preintegrated", "adaptive"]),
    ("step = 0.5", "tolerance = @0.001", &["tolerance", "adaptive", "riemann", "set step"]),
    ("step = 0.5", "tolerance = @0.0", &["tolerance", "at least", "less than 1"]),
    ("step = 0.5", "step = @0", &["step", "1e-6"]),
    ("step = 0.5", "step = @-1", &["step", "got -1"]),
    ("step = 0.5", "step = @1e7", &["step", "1e6"]),
    ("step = 0.5", "step = @\"fine\"", &["step", "f64"]),
    ("filter = \"exact\"", "filter = @\"cubic\"", &["filter", "cubic", "hardware"]),
    ("refine = \"exact\"", "refine = @\"never\"", &["refine", "never", "substitute"]),
    ("early_stop = 0.0", "early_stop = @1.0", &["early_stop", "less than 1"]),
    ("early_stop = 0.0", "early_stop = @-0.1", &["early_stop", "at least 0"]),
    ("atlas_mib = 64", "atlas_mib = @0", &["atlas_mib", "1 to"]),
    ("ram_mib = 1024", "ram_mib = @-5", &["ram_mib", "1 to"]),
    ("staging_mib = 2", "staging_mib = @16777217", &["staging_mib", "1 to"]),
];

const VOLUMES: &[Bad] = &[
    ("name = \"ball\"", "name = @\"\"", &["name", "empty"]),
    ("name = \"ball\"", "name = @7", &["name", "string"]),
    (SOURCE, "source = @\"no\\nwhere\\u0007.nii\"", &["no\\nwhere\\u{7}.nii", "cannot be read"]),
    (SOURCE, "", &["source", "missing", "computed"]),
    (SOURCE, "source = @\"\"", &["source", "empty"]),
    (SOURCE, "source = @3", &["source", "path"]),
    (SOURCE, "source = @\"missing.nii\"", &["missing.nii", "cannot be read", "\"ball\""]),
    (SOURCE, "source = @\".\"", &["is not a file", "\"ball\""]),
    (SOURCE, "source = @\"bytes.dat\"", &["bytes.dat", "format is not known"]),
    (SOURCE, "source = @\"bytes.raw\"", &["raw", "size = [x, y, z]", "type"]),
    (SOURCE, "source = @\"bytes.raw.gz\"", &["raw", "size = [x, y, z]", "type"]),
    (
        SOURCE,
        "source = @\"bytes.raw\"\nraw = { size = [4, 4, 4], type = \"u8\" }",
        &["bytes.raw", "60 bytes", "64", "size"],
    ),
    (
        SOURCE,
        "source = @\"bytes.raw\"\nraw = { size = [3, 4, 4], type = \"u8\" }",
        &["bytes.raw", "60 bytes", "48", "size"],
    ),
    (
        SOURCE,
        "source = @\"bytes.raw\"\nraw = { size = [1048576, 1048576, 1], type = \"f32\" }",
        &["bytes.raw", "60 bytes", "1048576 x 1048576 x 1"],
    ),
    (
        SOURCE,
        "source = \"bytes.raw\"\nraw = { size = @[4, 0, 4], type = \"u8\" }",
        &["size", "1 to", "got [4, 0, 4]"],
    ),
    (
        SOURCE,
        "source = \"bytes.raw\"\nraw = { size = [4, 4, 4], type = @\"u9\" }",
        &["type", "u9", "u8, u16, i16 or f32"],
    ),
    (
        SOURCE,
        "source = \"bytes.raw\"\nraw = { size = [4, 4, 4], type = \"u8\", endian = @\"middle\" }",
        &["endian", "middle", "little"],
    ),
    (
        SOURCE,
        "source = \"bytes.raw\"\nraw = @{ size = [4, 4, 4] }",
        &["raw", "missing field `type`"],
    ),
    (
        SOURCE,
        "source = \"bytes.raw\"\nraw = { size = [4, 4, 4], type = \"u8\", @format = 3 }",
        &["format", "`type`"],
    ),
    (
        SOURCE,
        "source = \"brain.nii.gz\"\nraw = @{ size = [4, 4, 4], type = \"u8\" }",
        &["raw", ".nii.gz", "leave it out"],
    ),
    (
        "spacing = [",
        "raw = @{ size = [4, 4, 4], type = \"u8\" }\nspacing = [",
        &["raw", "computed"],
    ),
    (SOURCE, "source = @{ computed = \"shell\", size = [4, 4, 4] }", &["shell", "shells"]),
    (SOURCE, "source = @{ size = [4, 4, 4] }", &["source", "missing field `computed`"]),
    (SOURCE, "source = @{ computed = \"shells\" }", &["source", "missing field `size`"]),
    (
        SOURCE,
        "source = { computed = \"shells\", size = [4, 4, 4], @seed = 3 }",
        &["seed", "`computed`"],
    ),
    ("size = [4, 4, 4]", "size = @[0, 4, 4]", &["size", "1 to 16777216", "got [0, 4, 4]"]),
    ("size = [4, 4, 4]", "size = @[4, 4, -4]", &["size", "1 to 16777216", "-4"]),
    ("size = [4, 4, 4]", "size = @[4, 16777217, 4]", &["size", "1 to 16777216"]),
    ("size = [4, 4, 4]", "size = @[4, 4]", &["size", "3"]),
    (SPACING, "spacing = @[1.0, 0.0, 1.0]", &["\"ball\"", "spacing", "positive", "got 0"]),
    (SPACING, "spacing = @[1.0, -1.0, 1.0]", &["\"ball\"", "spacing", "positive", "got -1"]),
    (SPACING, "spacing = @[1.0, 1e-31, 1.0]", &["\"ball\"", "spacing", "1e-30 and 1e30"]),
    (SPACING, "spacing = @[1.0, 1e31, 1.0]", &["\"ball\"", "spacing", "1e-30 and 1e30"]),
    (
        SPACING,
        "transform = @[[1, 0, 0, 1e31], [0, 1, 0, 0], [0, 0, 1, 0]]",
        &["\"ball\"", "transform", "origin within 1e30"],
    ),
    (SPACING, "spacing = @1.0", &["spacing", "array of length 3"]),
    (
        SPACING,
        "spacing = [1, 1, 1]\ntransform = @[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]",
        &["spacing or transform", "not both"],
    ),
    (
        SPACING,
        "transform = @[[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 0, 0]]",
        &["transform", "singular", "length 0"],
    ),
    (
        SPACING,
        "transform = @[[1, 0, 1, 0], [0, 1, 1, 0], [1, 1, 2, 0]]",
        &["transform", "singular", "plane"],
    ),
    (
        SPACING,
        "transform = [[1, 0, 0, 0], [0, 1, 0, 0], @[0, 0, 1]]",
        &["transform", "array of length 4"],
    ),
    (SPACING, "transform = @[[1, 0, 0, 0], [0, 1, 0, 0]]", &["transform", "array of length 3"]),
];

const CHANNELS: &[Bad] = &[
    ("index = 0", "index = @-1", &["index", "0 to 4294967295", "-1"]),
    ("index = 0", "index = @4294967296", &["index", "4294967295"]),
    ("window = [0.0, 255.0]", "", &["channel 0", "window = [lo, hi]", "missing"]),
    ("window = [0.0, 255.0]", "window = @[255.0, 0.0]", &["window", "lo < hi"]),
    ("window = [0.0, 255.0]", "window = @[1.0, 1.0]", &["window", "lo < hi"]),
    ("window = [0.0, 255.0]", "window = @[0.0, 1e39]", &["window", "finite"]),
    ("window = [0.0, 255.0]", "window = @255.0", &["window", "array of length 2"]),
    (FIRST_POINT, "  { at = @\"0\", color = [0, 0, 0], extinction = 0 },", &["at", "f64"]),
    (FIRST_POINT, "  @{ at = 1.5, color = [0, 0, 0], extinction = 0 },", &["at", "0 and 1", "1.5"]),
    (FIRST_POINT, "  @{ at = -0.5, color = [0, 0, 0], extinction = 0 },", &["at", "0 and 1"]),
    (FIRST_POINT, "  @{ at = 0, color = [0, -1, 0], extinction = 0 },", &["color", "-1"]),
    (FIRST_POINT, "  { at = 0, color = @[0, 0], extinction = 0 },", &["color", "length 3"]),
    (FIRST_POINT, "  @{ at = 0, color = [0, 0, 0], extinction = -1 },", &["extinction", "-1"]),
    (FIRST_POINT, "  @{ at = 0, color = [0, 0, 0], extinction = 1e25 },", &["extinction"]),
    (FIRST_POINT, "  @{ at = 0, color = [0, 0, 0] },", &["missing field `extinction`"]),
    (FIRST_POINT, "  @{ at = 0, extinction = 0.0 },", &["missing field `color`"]),
    (FIRST_POINT, "  @{ color = [0, 0, 0], extinction = 0.0 },", &["missing field `at`"]),
    (
        "  { at = 1.0, color = [1.0, 0.5, 0.25], extinction = 0.5 },",
        "  { at = 1, color = [1, 1, 1], extinction = 1 },\n  @{ at = 0.5, color = [1, 1, 1], extinction = 1 },",
        &["order", "0.5", "1"],
    ),
    (
        "  { at = 1.0, color = [1.0, 0.5, 0.25], extinction = 0.5 },",
        "  { at = 0, color = [1, 1, 1], extinction = 1 },\n  @{ at = 0, color = [1, 1, 1], extinction = 1 },",
        &["two points", "three"],
    ),
    ("[[volume.channel]]\nindex = 0", "@[[volume.channel]]\nindex = 1", &["index 1", "index 0"]),
];

const VIEWS: &[Bad] = &[
    ("name = \"front\"", "name = @\"fr/ont\"", &["name", "letters", "fr/ont"]),
    ("name = \"front\"", "name = @\"..\"", &["name", "letters"]),
    ("name = \"front\"", "name = @\"\"", &["name", "letters"]),
    ("name = \"front\"", "name = @\"a\\nb\"", &["name", "letters", "a\\nb"]),
    ("eye = [2.0, 2.0, -8.0]", "", &["eye = [x, y, z]", "missing"]),
    ("target = [2.0, 2.0, 2.0]", "", &["target = [x, y, z]", "missing"]),
    ("up = [0.0, 1.0, 0.0]", "", &["up = [x, y, z]", "missing"]),
    ("target = [2.0, 2.0, 2.0]", "target = @[2.0, 2.0, -8.0]", &["eye and target", "differ"]),
    ("up = [0.0, 1.0, 0.0]", "up = @[0.0, 0.0, 3.0]", &["up", "parallel"]),
    ("up = [0.0, 1.0, 0.0]", "up = @[0.0, 0.0, -1e-5]", &["up", "parallel"]),
    ("up = [0.0, 1.0, 0.0]", "up = @[0.0, 0.0, 0.0]", &["up", "zero"]),
    ("up = [0.0, 1.0, 0.0]", "up = @[0.0, 1.0]", &["up", "length 3"]),
    ("up = [0.0, 1.0, 0.0]", "up = @\"y\"", &["up", "length 3"]),
    ("eye = [2.0, 2.0, -8.0]", "eye = @[2.0, 2.0, 1e31]", &["eye", "1e30"]),
    (FOV, "fov_degrees = @0", &["fov_degrees", "179", "got 0"]),
    (FOV, "fov_degrees = @180.0", &["fov_degrees", "179", "got 180"]),
    (FOV, "fov_degrees = @-40.0", &["fov_degrees", "179"]),
    (FOV, "", &["fov_degrees", "height", "frustum"]),
    (FOV, "fov_degrees = 40.0\nheight = 3.0", &["one of fov_degrees"]),
    (FOV, "height = @0", &["height", "positive"]),
    (FOV, "height = @-1.0", &["height", "positive"]),
    (FOV, "frustum = @[1, -1, -1, 1]", &["frustum", "left < right"]),
    (FOV, "frustum = @[-1, 1, 1, -1]", &["frustum", "bottom < top"]),
    (FOV, "frustum = @[-1, 1, -1]", &["frustum", "length 4"]),
];

/// Checks one sentence: `place` is the line and column it must name, where one is given.
fn complaint(run: &Run, place: Option<(usize, usize)>, says: &[&str]) -> Option<String> {
    let sentence = match run.sentence() {
        Ok(sentence) => sentence,
        Err(why) => return Some(why),
    };
    if run.code != Some(3) {
        return Some(format!("exit code {:?}, not 3: {sentence}", run.code));
    }
    let Some((_, behind)) = sentence.split_once("scene.toml:") else {
        return Some(format!("names no place: {sentence}"));
    };
    let mut parts = behind.splitn(3, ':');
    let number = |part: Option<&str>| part.and_then(|part| part.parse::<usize>().ok());
    let (Some(line), Some(column)) = (number(parts.next()), number(parts.next())) else {
        return Some(format!("names no line and column: {sentence}"));
    };
    if let Some(wanted) = place
        && wanted != (line, column)
    {
        return Some(format!("names {line}:{column}, not {}:{}: {sentence}", wanted.0, wanted.1));
    }
    let message = parts.next().unwrap_or("");
    let missing: Vec<_> = says.iter().filter(|word| !message.contains(**word)).collect();
    (!missing.is_empty()).then(|| format!("does not say {missing:?}: {sentence}"))
}

/// Line and column, from 1, of the byte `at`.
fn place_of(text: &str, at: usize) -> (usize, usize) {
    let before = &text[..at];
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
}

/// A folder with the files that bad scenes name.
fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    folder.write("bytes.raw", [0; 60]);
    folder.write("bytes.dat", [0; 60]);
    folder
}

fn render(folder: &Folder, text: impl AsRef<[u8]>) -> Run {
    let scene = folder.write("scene.toml", text);
    let picture = folder.path("picture.png");
    ashfall(["render".as_ref(), scene.as_os_str(), "-o".as_ref(), picture.as_os_str()])
}

fn check_table(name: &str, table: &[Bad]) {
    let folder = folder(name);
    let mut wrong = Vec::new();
    for (find, put, says) in table {
        assert_eq!(GOOD.matches(find).count(), 1, "{find:?} stands in the good scene once");
        let marked = GOOD.replace(find, put);
        let place = marked.find('@').map(|at| place_of(&marked, at));
        let run = render(&folder, marked.replace('@', ""));
        if let Some(why) = complaint(&run, place, says) {
            wrong.push(format!("{put:?} instead of {find:?}: {why}"));
        }
    }
    assert!(wrong.is_empty(), "{} sentences are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn format_and_tables() {
    check_table("bad-format", FORMAT_AND_TABLES);
}

#[test]
fn picture_quality_and_memory() {
    check_table("bad-picture", PICTURE_QUALITY_MEMORY);
}

#[test]
fn volumes() {
    check_table("bad-volumes", VOLUMES);
}

#[test]
fn channels() {
    check_table("bad-channels", CHANNELS);
}

#[test]
fn views() {
    check_table("bad-views", VIEWS);
}

/// Every number of three scenes in turn becomes NaN and both infinities.
#[test]
fn no_number_may_be_nan_or_infinite() {
    let transform =
        "transform = [[1.0, 0.0, 0.0, 5.0], [0.0, 2.0, 0.0, 6.0], [0.0, 0.0, 3.0, 7.0]]";
    let raw = "source = \"bytes.raw\"\nraw = { size = [3, 4, 5], type = \"u8\" }";
    let scenes = [
        GOOD.to_owned(),
        GOOD.replace(SPACING, transform).replace(SOURCE, raw).replace(FOV, "height = 3.0"),
        GOOD.replace(FOV, "frustum = [-1.0, 1.0, -1.0, 1.0]"),
    ];
    let folder = folder("bad-numbers");
    let mut wrong = Vec::new();
    for (index, scene) in scenes.iter().enumerate() {
        for (start, end, key) in numbers(scene) {
            // What the first scene has shown need not be shown again.
            if index > 0 && GOOD.contains(scene[..end].lines().last().unwrap_or("")) {
                continue;
            }
            for bad in ["nan", "inf", "-inf"] {
                let text = format!("{}{bad}{}", &scene[..start], &scene[end..]);
                let run = render(&folder, &text);
                let (line, column) = place_of(scene, start);
                let named = run.sentence().unwrap_or("").to_owned();
                let why = complaint(&run, None, &[&key]).or_else(|| {
                    // The value as a whole may be named, an array or a point, but not another line.
                    let same_line = named.contains(&format!("scene.toml:{line}:"));
                    (!same_line).then(|| format!("not about line {line}: {named}"))
                });
                if let Some(why) = why {
                    wrong.push(format!("{bad} at {line}:{column}: {why}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{} sentences are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

/// Start and end of every number outside strings, and the key that it belongs to.
fn numbers(text: &str) -> Vec<(usize, usize, String)> {
    let bytes = text.as_bytes();
    let part = |byte: u8| byte.is_ascii_digit() || b".-+e".contains(&byte);
    let mut found = Vec::new();
    let mut at = 1;
    while at < bytes.len() {
        let begins = bytes[at].is_ascii_digit() || bytes[at] == b'-';
        if !(begins && b" [".contains(&bytes[at - 1])) {
            at += 1;
            continue;
        }
        let end = at + bytes[at..].iter().take_while(|byte| part(**byte)).count();
        let before = &text[..text[..at].rfind(" =").expect("a key before a number")];
        let key = before.rsplit(|c: char| !(c.is_alphanumeric() || c == '_')).next();
        found.push((at, end, key.expect("a key").to_owned()));
        at = end;
    }
    found
}

#[test]
fn numbers_are_found_with_their_keys() {
    let found = numbers("a = 1\nb = { c = [-2.5, 3], d = 4e5 }\n");
    let keys: Vec<_> = found.iter().map(|(_, _, key)| key.as_str()).collect();
    assert_eq!(keys, ["a", "c", "c", "d"]);
    assert_eq!((found[1].0, found[1].1), (17, 21));
    assert_eq!(numbers(GOOD).len(), 41);
}

#[test]
fn parts_that_are_missing_or_too_many() {
    let folder = folder("bad-parts");
    let volume = &GOOD[GOOD.find("[[volume]]").unwrap()..GOOD.find("[[view]]").unwrap()];
    let view = &GOOD[GOOD.find("[[view]]").unwrap()..];
    let channel = &volume[volume.find("[[volume.channel]]").unwrap()..];
    let seventeen: String =
        (0..17).map(|index| channel.replace("index = 0", &format!("index = {index}"))).collect();
    let cases = [
        (GOOD.replace(volume, ""), vec!["[[volume]]"]),
        (GOOD.replace(view, ""), vec!["[[view]]"]),
        (GOOD.replace(channel, ""), vec!["\"ball\"", "[[volume.channel]]"]),
        (GOOD.replace(channel, &seventeen), vec!["17 channels", "16"]),
        (GOOD.replace(channel, &channel.repeat(2)), vec!["channel 0", "twice"]),
        (GOOD.replace(volume, &volume.repeat(2)), vec!["two volumes", "\"ball\""]),
        (format!("{GOOD}{view}"), vec!["two views", "\"front\""]),
        (
            GOOD.replace(volume, &format!("{volume}{}", volume.replace("ball", "box"))),
            vec!["\"box\"", "not built yet", "leave one"],
        ),
        ("".to_owned(), vec!["format = 1"]),
    ];
    let mut wrong = Vec::new();
    for (text, says) in cases {
        if let Some(why) = complaint(&render(&folder, text), None, &says) {
            wrong.push(why);
        }
    }
    assert!(wrong.is_empty(), "{} sentences are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn files_that_are_no_scenes() {
    let folder = folder("bad-files");
    let run = render(&folder, b"format = 1\n\xff\xfe");
    let sentence = run.sentence().expect("one sentence");
    assert_eq!(run.code, Some(3));
    assert!(sentence.contains("scene.toml:2:1:") && sentence.contains("UTF-8"), "{sentence}");

    for (path, says) in [
        (folder.path("nowhere.toml"), "nowhere.toml: "),
        (folder.as_ref().join("scene.toml").join("below.toml"), "cannot be read"),
    ] {
        let run = ashfall(["render".as_ref(), path.as_os_str()]);
        let sentence = run.sentence().expect("one sentence");
        assert_eq!(run.code, Some(3), "{sentence}");
        assert!(sentence.contains(says) && sentence.contains("cannot be read"), "{sentence}");
    }
}

/// What no memory holds is refused before memory is asked for: 1 GiB of address space is enough.
#[test]
fn too_many_voxels_are_refused_before_any_allocation() {
    let folder = folder("bad-sizes");
    let sparse = std::fs::File::create(folder.path("huge.raw")).expect("a sparse file");
    let held = sparse.set_len(1 << 40).is_ok();
    let mut cases = vec![
        (GOOD.replace("[4, 4, 4]", "[1048576, 1048576, 1]"), "1048576 x 1048576 x 1", "lower size"),
        (GOOD.replace("[4, 4, 4]", "[16384, 16384, 4096]"), "16384 x 16384 x 4096", "lower size"),
        (
            GOOD.replace("[4, 4, 4]", "[16777216, 16777216, 16777216]"),
            "16777216 x 16777216",
            "lower size",
        ),
        (GOOD.replace("[4, 4, 4]", "[1024, 1024, 1025]"), "1024 x 1024 x 1025", "lower size"),
    ];
    if held {
        let raw = "source = \"huge.raw\"\nraw = { size = [1048576, 1048576, 1], type = \"u8\" }";
        let remedy = "huge.raw -o OUT.bricks`) or raise --ram-mib";
        cases.push((GOOD.replace(SOURCE, raw), "1048576 x 1048576 x 1", remedy));
    } else {
        eprintln!("SKIPPED: this file system holds no sparse file of 1 TiB");
    }
    for (text, size, remedy) in cases {
        let scene = folder.write("scene.toml", text);
        let run = ashfall_within(
            1 << 20,
            ["render".as_ref(), scene.as_os_str(), "--addressing".as_ref(), "direct".as_ref()],
        );
        let says = ["\"ball\"", size, "MiB", "ram_mib", "--ram-mib", remedy];
        assert_eq!(complaint(&run, None, &says), None);
    }
}

#[test]
fn flags() {
    let folder = folder("bad-flags");
    let scene = folder.write("scene.toml", GOOD);
    // A sentence of ours, which names the flag first; what clap refuses has its own form.
    let ours: &[(&[&str], &str)] = &[
        (&["--step", "-1"], "--step"),
        (&["--step", "nan"], "--step"),
        (&["--step", "inf"], "--step"),
        (&["--size", "0x5"], "--size"),
        (&["--size", "5x99999"], "--size"),
        (&["--background", "0,nan,0"], "--background"),
        (&["--background", "-1,0,0"], "--background"),
        (&["--integrator", "simpson"], "--integrator"),
        (&["--tolerance", "0.1"], "--tolerance"),
        (&["--filter", "foo"], "--filter"),
        (&["--refine", "foo"], "--refine"),
        (&["--level-max", "-1"], "--level-max"),
        (&["--level-max", "99"], "--level-max"),
        (&["--early-stop", "1"], "--early-stop"),
        (&["--early-stop", "nan"], "--early-stop"),
        (&["--atlas-mib", "0"], "--atlas-mib"),
        (&["--ram-mib", "-7"], "--ram-mib"),
        (&["--staging-mib", "0"], "--staging-mib"),
        (&["--tile", "0x0"], "--tile"),
        (&["--tile", "9000x8"], "--tile"),
        (&["--steps-per-dispatch", "0"], "--steps-per-dispatch"),
        (&["--steps-per-dispatch", "65536"], "--steps-per-dispatch"),
        (&["--view", "back"], "--view"),
        (&["-o", "picture.jpg"], "picture.jpg"),
        (&["-o", "picture"], "picture"),
    ];
    let claps: &[(&[&str], &str)] = &[
        (&["--size", "x"], "--size"),
        (&["--size", "5"], "--size"),
        (&["--size", "5x5x5"], "--size"),
        (&["--background", "red"], "--background"),
        (&["--step", "fine"], "--step"),
        (&["--atlas-mib", "1.5"], "--atlas-mib"),
        (&["--layout", "tiled"], "--layout"),
        (&["--sise", "5x5"], "--size"),
        (&["--step"], "--step"),
        (&["--step", "1", "--step", "2"], "--step"),
        (&["second.toml"], "second.toml"),
    ];
    let mut wrong = Vec::new();
    for (flags, word) in ours.iter().chain(claps) {
        let run = ashfall(
            [std::ffi::OsStr::new("render"), scene.as_os_str()]
                .into_iter()
                .chain(flags.iter().map(AsRef::as_ref)),
        );
        let is_ours = ours.iter().any(|(known, _)| known == flags);
        let sentence = if is_ours { run.sentence() } else { Ok(&run.stderr[..]) };
        match sentence {
            Err(why) => wrong.push(format!("{flags:?}: {why}")),
            Ok(text) if run.code != Some(2) || !text.contains(word) || !run.stdout.is_empty() => {
                wrong.push(format!("{flags:?}: exit code {:?}: {text}", run.code));
            }
            Ok(text) if is_ours && !text.starts_with(word) => {
                wrong.push(format!("{flags:?}: the place does not stand first: {text}"));
            }
            Ok(_) => {}
        }
    }
    assert!(wrong.is_empty(), "{} refusals are wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn a_wrong_sentence_is_noticed() {
    let run = |code, stderr: &str| Run {
        code: Some(code),
        stdout: String::new(),
        stderr: stderr.to_owned(),
    };
    let good = "ashfall: scene.toml:3:9: step must be positive\n";
    let place = Some((3, 9));
    assert_eq!(complaint(&run(3, good), place, &["step"]), None);
    for (run, place, says) in [
        (run(1, good), place, "step"),
        (run(3, good), Some((3, 8)), "step"),
        (run(3, good), place, "size"),
        (run(3, "ashfall: step must be positive\n"), None, "step"),
        (run(3, "ashfall: scene.toml:3: step must be positive\n"), None, "step"),
        (run(3, "thread 'main' panicked\n"), place, "step"),
        (run(3, "ashfall: scene.toml:3:9: step\nmust be\n"), place, "step"),
        (run(3, ""), place, "step"),
    ] {
        assert!(complaint(&run, place, &[says]).is_some(), "{}", run.stderr);
    }
}
