//! House rules that a program can hold the code to: rooms and their doors, the mirror of shaders,
//! passes and twins, unsafe code, words that must not be written, first lines, lengths.
//!
//! Each rule is a function from files to complaints, and is shown to complain about a bad sample.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// A file as the rules see it: its path in the repository, with slashes, and its text.
type File<'a> = (&'a str, &'a str);

/// DESIGN section 3: what each room may use beside itself and `error`. Four refinements: the structs
/// that host and shaders share live in `twins`, so passes use them; `error` is every room's. The viewer
/// hands devices and windows on to `gpu`; `study` prices a trace.
const ROOMS: &[(&str, &[&str])] = &[
    ("error", &[]),
    ("volume", &[]),
    ("scene", &["volume"]),
    ("source", &["volume"]),
    ("store", &["volume", "source"]),
    ("import", &["volume", "source", "store"]),
    ("loading", &["volume", "source"]),
    ("gpu", &[]),
    ("passes", &["gpu", "volume", "twins"]),
    ("twins", &["volume"]),
    ("residency", &["passes", "gpu", "volume", "twins"]),
    (
        "render",
        &["volume", "scene", "source", "loading", "gpu", "passes", "twins", "residency", "trace"],
    ),
    ("reference", &["volume", "scene", "source"]),
    (
        "study",
        &[
            "volume",
            "scene",
            "source",
            "store",
            "import",
            "loading",
            "gpu",
            "passes",
            "twins",
            "residency",
            "render",
            "reference",
            "trace",
        ],
    ),
    ("trace", &["gpu", "volume"]),
    ("viewer", &["volume", "gpu", "render", "reference", "scene", "study", "trace"]),
    (
        "cli",
        &[
            "volume",
            "scene",
            "source",
            "store",
            "import",
            "loading",
            "gpu",
            "passes",
            "twins",
            "residency",
            "render",
            "reference",
            "study",
            "trace",
            "viewer",
        ],
    ),
];

/// Crates from outside that a room may name; other rooms are free.
const CRATES_OF_ROOMS: &[(&str, &[&str])] = &[("twins", &["bytemuck"])];
/// Crates that only these rooms may name: no Vulkan outside `gpu`.
const ROOMS_OF_CRATES: &[(&str, &[&str])] =
    &[("ash", &["gpu"]), ("gpu_allocator", &["gpu"]), ("clap", &["cli"]), ("toml", &["scene"])];

/// Files in src/passes and src/twins that belong to no shader.
/// `march_shape`: what cast and march share; `brick_shape`: what shapes march_bricks; `cache_buffers`:
/// what the passes that manage the cache share. `octree_*`: what the host keeps of
/// the residency octree.
const PASSES_ALONE: &[&str] = &["brick_shape", "cache_buffers", "march_shape", "mod", "sources"];
const TWINS_ALONE: &[&str] =
    &["mod", "octree_ranges", "octree_shape", "octree_walk", "octree_words"];

/// Files that may be longer than [`LINES_MAX`], and why.
const LONG_FILES: &[(&str, &str)] = &[
    ("Cargo.lock", "written by cargo"),
    ("tests/contract.rs", "all that shaders and hosts say of each other, with planted mismatches"),
    ("tests/tidy.rs", "all house rules in one place, each with its bad samples"),
];
const LINES_MAX: usize = 600;

// Split, so that this file does not hold what it looks for.
const BANNED: &[(&str, &str)] = &[
    (concat!("keep in ", "sync"), "let a test read both places instead"),
    (concat!("kept in ", "sync"), "let a test read both places instead"),
    (concat!("/wo", "rk/"), "no machine's paths: use one relative to the repository"),
    (concat!("/ho", "me/"), "no machine's paths: use one relative to the repository"),
    (concat!("/ro", "ot/"), "no machine's paths: use one relative to the repository"),
    (concat!("/Use", "rs/"), "no machine's paths: use one relative to the repository"),
    (concat!("index.crates", ".io"), "no registry hosts: cargo knows its own"),
    (concat!("static.crates", ".io"), "no registry hosts: cargo knows its own"),
    (concat!("deb.debian", ".org"), "no package hosts: the machine's own sources say it"),
    (concat!("py", "pi.org"), "no package hosts: the machine's own sources say it"),
    (concat!("artifact", "ory"), "no package hosts: the machine's own sources say it"),
];
const UNFINISHED: &[&str] = &[concat!("TO", "DO"), concat!("FIX", "ME"), concat!("XX", "X")];

/// The room of a file in src/: its folder, or its name at the top. lib.rs and main.rs stand above.
fn room(path: &str) -> Option<&str> {
    let inside = path.strip_prefix("src/")?;
    match inside.split_once('/') {
        Some((room, _)) => Some(room),
        None => inside.strip_suffix(".rs").filter(|name| !["lib", "main"].contains(name)),
    }
}

/// Code alone: without comments and without what strings hold, line by line.
fn code_lines(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    let mut chars = text.chars().peekable();
    let (mut string, mut comment) = (false, false);
    while let Some(c) = chars.next() {
        if c == '\n' {
            comment = false;
            lines.push(String::new());
            continue;
        }
        let line = lines.last_mut().expect("a line");
        match c {
            _ if comment => {}
            '\\' if string => {
                // A string that goes on in the next line keeps the count of lines.
                if chars.next() == Some('\n') {
                    lines.push(String::new());
                }
            }
            '"' => {
                string = !string;
                line.push('"');
            }
            _ if string => {}
            '\'' if chars.peek() == Some(&'"') => {
                chars.next();
            }
            '/' if chars.peek() == Some(&'/') => comment = true,
            _ => line.push(c),
        }
    }
    lines
}

/// Which rooms a file names through `crate::`, each with its line.
fn doors(text: &str) -> Vec<(usize, String)> {
    let code = code_lines(text).join("\n");
    let mut found = Vec::new();
    for (at, door) in code.match_indices("crate::") {
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let line = code[..at].matches('\n').count() + 1;
        let after = &code[at + door.len()..];
        let Some(list) = after.strip_prefix('{') else {
            found.push((line, word(after).to_owned()));
            continue;
        };
        // The names at the top of the list's own tree.
        let (mut depth, mut start) = (0, 0);
        for (end, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                ',' | '}' if depth == 0 => {
                    let name = word(list[start..end].trim());
                    found.extend((!name.is_empty()).then(|| (line, name.to_owned())));
                    start = end + 1;
                    if c == '}' {
                        break;
                    }
                }
                '}' => depth -= 1,
                _ => {}
            }
        }
    }
    found
}

/// The identifier that a text begins with.
fn word(text: &str) -> &str {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap_or("")
}

fn rooms(files: &[File]) -> Vec<String> {
    let mut wrong = Vec::new();
    for (path, text) in files.iter().filter(|(path, _)| path.ends_with(".rs")) {
        let Some(room) = room(path) else { continue };
        let Some((_, may)) = ROOMS.iter().find(|(name, _)| *name == room) else {
            wrong.push(format!(
                "{path}: room \"{room}\" is not in the table: move the file, or add the room to DESIGN section 3 and to ROOMS in tests/tidy.rs"
            ));
            continue;
        };
        for (line, used) in doors(text) {
            let known = ROOMS.iter().any(|(name, _)| *name == used);
            if known && used != room && used != "error" && !may.contains(&used.as_str()) {
                wrong.push(format!(
                    "{path}:{line}: room \"{room}\" may not use \"{used}\", only {may:?}: hand the data over as an argument, or move the code up a room"
                ));
            } else if !known {
                wrong.push(format!(
                    "{path}:{line}: crate::{used} is no room: name the item by its room"
                ));
            }
        }
        for (index, line) in code_lines(text).iter().enumerate() {
            if let Some(used) = crates_of(line) {
                let closed = CRATES_OF_ROOMS.iter().find(|(name, _)| *name == room);
                let open_to = ROOMS_OF_CRATES.iter().find(|(name, _)| *name == used);
                if closed.is_some_and(|(_, crates)| !crates.contains(&used))
                    || open_to.is_some_and(|(_, rooms)| !rooms.contains(&room))
                {
                    wrong.push(format!(
                        "{path}:{}: room \"{room}\" may not use the crate {used}: see CRATES_OF_ROOMS and ROOMS_OF_CRATES in tests/tidy.rs",
                        index + 1
                    ));
                }
            }
        }
    }
    wrong
}

/// The crate that a line's `use` brings in, if it is one from outside.
fn crates_of(line: &str) -> Option<&str> {
    let line = line.trim_start();
    let line = line.strip_prefix("pub ").unwrap_or(line);
    let name = word(line.strip_prefix("use ")?);
    let own = ["crate", "std", "core", "super", "self"];
    (!own.contains(&name) && line.contains("::")).then_some(name)
}

fn mirror(files: &[File], sources: &[File]) -> Vec<String> {
    let names = |folder: &str, ending: &str| -> BTreeSet<String> {
        let inside = files.iter().filter_map(|(path, _)| path.strip_prefix(folder));
        let plain = inside.filter_map(|name| name.strip_suffix(ending));
        plain.filter(|name| !name.contains('/')).map(str::to_owned).collect()
    };
    let shaders = names("shaders/", ".comp");
    let common = names("shaders/common/", ".glsl");
    let mut wrong = Vec::new();
    // shaders/X.comp has src/passes/X.rs and src/twins/X.rs; shaders/common/X.glsl has src/twins/X.rs;
    // and nothing else is in these rooms but what *_ALONE lists.
    let mut compare = |what: &str, wanted: &BTreeSet<String>, found: BTreeSet<String>| {
        for name in wanted.difference(&found) {
            wrong.push(format!("{} is missing: its shader has it", what.replace('*', name)));
        }
        for name in found.difference(wanted) {
            wrong.push(format!(
                "{} has no shader of its name: rename or move it, or list it in tests/tidy.rs with its reason",
                what.replace('*', name)
            ));
        }
    };
    let without = |names: BTreeSet<String>, alone: &[&str]| -> BTreeSet<String> {
        names.into_iter().filter(|name| !alone.contains(&name.as_str())).collect()
    };
    compare("src/passes/*.rs", &shaders, without(names("src/passes/", ".rs"), PASSES_ALONE));
    let both = shaders.union(&common).cloned().collect();
    compare("src/twins/*.rs", &both, without(names("src/twins/", ".rs"), TWINS_ALONE));
    for name in shaders.intersection(&common) {
        wrong.push(format!(
            "shaders/{name}.comp and shaders/common/{name}.glsl share a twin: rename one"
        ));
    }
    // What the binary carries is what stands on disk.
    for (path, text) in files {
        let Some(name) = path.strip_prefix("shaders/") else { continue };
        match sources.iter().find(|(known, _)| *known == name) {
            None => {
                wrong.push(format!("{path} is not in SOURCES: add it to src/passes/sources.rs"))
            }
            Some((_, carried)) if carried != text => {
                wrong.push(format!("SOURCES holds another text as {name}: check its include_str!"));
            }
            Some(_) => {}
        }
    }
    wrong
}

fn unsafe_code(files: &[File]) -> Vec<String> {
    let mut wrong = Vec::new();
    for (path, text) in files.iter().filter(|(path, _)| path.ends_with(".rs")) {
        let code = code_lines(text);
        let written: Vec<&str> = text.lines().collect();
        for (index, line) in code.iter().enumerate() {
            let parts = line.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            if !parts.clone().any(|part| part == "unsafe") {
                continue;
            }
            let at = format!("{path}:{}", index + 1);
            if !path.starts_with("src/gpu/") {
                wrong.push(format!("{at}: unsafe code outside src/gpu/: move it there"));
                continue;
            }
            // Upwards over comments, attributes and the lines of the statement that holds the block.
            let promised = written[..index]
                .iter()
                .rev()
                .map(|line| line.trim())
                .take_while(|line| {
                    let ends = line.is_empty() || line.ends_with(['}', ';']);
                    !ends || line.starts_with("//")
                })
                .take(12)
                .any(|line| line.contains("// SAFETY:") || line.starts_with("/// # Safety"));
            if !promised {
                wrong.push(format!("{at}: no `// SAFETY:` before it: say who keeps which promise"));
            }
        }
    }
    wrong
}

fn banned(files: &[File]) -> Vec<String> {
    let mut wrong = Vec::new();
    for (path, text) in files {
        for (index, line) in text.lines().enumerate() {
            let at = format!("{path}:{}", index + 1);
            // Cargo.lock names the registry of every crate; nobody writes it by hand.
            if *path != "Cargo.lock" {
                let lower = line.to_lowercase();
                for (phrase, remedy) in BANNED {
                    if lower.contains(&phrase.to_lowercase()) {
                        wrong.push(format!("{at}: holds \"{phrase}\": {remedy}"));
                    }
                }
            }
            for word in UNFINISHED {
                let mut places = line.match_indices(word);
                // A place to look: an issue, or a document.
                let with_place = |after: &str| {
                    let after = after.strip_prefix('(').unwrap_or(after).trim_start();
                    let numbered = |rest: &str| rest.starts_with(|c: char| c.is_ascii_digit());
                    after.strip_prefix('#').is_some_and(numbered)
                        || after.strip_prefix("issue ").is_some_and(numbered)
                        || after.strip_prefix("docs/").is_some()
                };
                let part_of_word = |at: usize, c: char| line[at..].starts_with(c);
                if places.any(|(start, _)| {
                    let end = start + word.len();
                    let inner = line[..start].ends_with(char::is_alphanumeric)
                        || line[end..].starts_with(char::is_alphanumeric)
                        || part_of_word(end, '_');
                    !inner && !with_place(&line[end..])
                }) {
                    wrong.push(format!(
                        "{at}: {word} without a place to look: do it, or write {word}(#12)"
                    ));
                }
            }
        }
    }
    wrong
}

/// `#define NAME number` of limits.glsl against `pub const NAME: type = number` of limits.rs.
fn limits(glsl: &str, rust: &str) -> Vec<String> {
    let defined: Vec<(&str, Option<f64>)> = glsl
        .lines()
        .filter_map(|line| line.trim().strip_prefix("#define "))
        .filter_map(|line| line.trim().split_once(char::is_whitespace).or(Some((line.trim(), ""))))
        .map(|(name, value)| (name, number(value.split("//").next().unwrap_or(""))))
        .collect();
    let constants: Vec<(&str, Option<f64>)> = rust
        .lines()
        .filter_map(|line| line.trim().strip_prefix("pub const "))
        .filter_map(|line| {
            let (name, rest) = line.split_once(':')?;
            Some((name.trim(), number(rest.split_once('=')?.1.split(';').next()?)))
        })
        .collect();
    let mut wrong = Vec::new();
    for (name, value) in &defined {
        match constants.iter().find(|(known, _)| known == name) {
            _ if value.is_none() => wrong.push(format!("limits.glsl: {name} is not one number")),
            None => wrong.push(format!("src/twins/limits.rs lacks {name}: add it")),
            Some((_, other)) if other != value => wrong.push(format!(
                "{name} is {value:?} in limits.glsl and {other:?} in src/twins/limits.rs: make them equal"
            )),
            Some(_) => {}
        }
    }
    for (name, _) in &constants {
        if !defined.iter().any(|(known, _)| known == name) {
            wrong.push(format!(
                "shaders/common/limits.glsl lacks {name}: define it, or keep the constant elsewhere"
            ));
        }
    }
    if defined.is_empty() {
        wrong.push("limits.glsl defines nothing that this test can read".to_owned());
    }
    wrong
}

fn number(text: &str) -> Option<f64> {
    let text = text.trim().replace('_', "");
    if let Some(digits) = text.strip_prefix("0x") {
        return u32::from_str_radix(digits.trim_end_matches('u'), 16).ok().map(f64::from);
    }
    let text = text.trim_end_matches("u32").trim_end_matches("f32").trim_end_matches(['u', 'f']);
    text.parse().ok()
}

fn first_lines(files: &[File]) -> Vec<String> {
    let mut wrong = Vec::new();
    for (path, text) in files {
        if path.ends_with(".rs") {
            let head: Vec<&str> = text
                .lines()
                .map_while(|line| line.strip_prefix("//!"))
                .map(str::trim)
                .take_while(|line| !line.is_empty())
                .collect();
            let head = head.join(" ");
            if head.len() < 12 || !head.ends_with(['.', ':']) {
                wrong.push(format!(
                    "{path}: begins without a `//!` sentence: say in one what the file is for"
                ));
            }
        }
        if path.ends_with(".comp") || path.ends_with(".glsl") {
            let name = path.rsplit('/').next().unwrap_or(path);
            let wanted = format!("// {name}: ");
            let first = text.lines().next().unwrap_or("");
            if !first.starts_with(&wanted) || first.len() < wanted.len() + 8 {
                wrong.push(format!("{path}: does not begin with `{wanted}` and its purpose"));
            }
        }
    }
    wrong
}

fn lengths(files: &[File]) -> Vec<String> {
    let mut wrong = Vec::new();
    for (path, text) in files {
        let lines = text.lines().count();
        let named = LONG_FILES.iter().any(|(known, _)| known == path);
        if lines > LINES_MAX && !named {
            wrong.push(format!(
                "{path}: {lines} lines, more than {LINES_MAX}: part it, or name it with a reason in LONG_FILES of tests/tidy.rs"
            ));
        }
        if lines <= LINES_MAX && named {
            wrong.push(format!("{path}: {lines} lines, no longer long: take it out of LONG_FILES"));
        }
    }
    for (known, reason) in LONG_FILES {
        if !files.iter().any(|(path, _)| path == known) || reason.is_empty() {
            wrong.push(format!("{known}: in LONG_FILES without a file or a reason: take it out"));
        }
    }
    wrong
}

/// Every text file that git tracks or would track. Outside a repository: what src, shaders, tests,
/// benches, tools and docs hold.
fn tracked() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let listed = Command::new("git")
        .args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"])
        .current_dir(root)
        .output();
    let names: Vec<String> = match listed {
        Ok(output) if output.status.success() => String::from_utf8_lossy(&output.stdout)
            .split('\0')
            .filter(|name| !name.is_empty())
            .map(str::to_owned)
            .collect(),
        _ => {
            let mut names = vec!["Cargo.toml".to_owned(), "Cargo.lock".to_owned()];
            for folder in ["src", "shaders", "tests", "benches", "tools", "docs"] {
                walk(root, folder, &mut names);
            }
            names
        }
    };
    let text = |name: &String| {
        let bytes = std::fs::read(root.join(name)).ok()?;
        (!bytes.contains(&0)).then(|| String::from_utf8(bytes).ok()).flatten()
    };
    names.iter().filter_map(|name| Some((name.clone(), text(name)?))).collect()
}

fn walk(root: &Path, folder: &str, names: &mut Vec<String>) {
    for entry in std::fs::read_dir(root.join(folder)).into_iter().flatten().flatten() {
        let name = format!("{folder}/{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() { walk(root, &name, names) } else { names.push(name) }
    }
}

fn hold(rule: impl Fn(&[File]) -> Vec<String>) {
    let files = tracked();
    let files: Vec<File> = files.iter().map(|(path, text)| (&path[..], &text[..])).collect();
    assert!(files.len() > 50, "only {} files are found", files.len());
    let wrong = rule(&files);
    assert!(wrong.is_empty(), "{} complaints:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn rooms_use_only_the_rooms_below_them() {
    hold(rooms);
}

#[test]
fn shaders_passes_and_twins_mirror_each_other() {
    hold(|files| mirror(files, ashfall::passes::SOURCES));
}

#[test]
fn unsafe_code_stays_in_gpu_and_says_why_it_is_sound() {
    hold(unsafe_code);
}

#[test]
fn nothing_banned_is_written() {
    hold(banned);
}

#[test]
fn limits_are_the_same_for_host_and_shaders() {
    hold(|files| {
        let text = |wanted| files.iter().find(|(path, _)| *path == wanted).expect("limits").1;
        limits(text("shaders/common/limits.glsl"), text("src/twins/limits.rs"))
    });
}

#[test]
fn files_begin_with_their_purpose() {
    hold(first_lines);
}

#[test]
fn files_are_short() {
    hold(lengths);
}

/// Each sample draws exactly one complaint, which holds the word beside it.
fn draws(rule: impl Fn(&[File]) -> Vec<String>, samples: &[(&[File], &str)]) {
    for (files, word) in samples {
        let wrong = rule(files);
        assert!(
            wrong.len() == 1 && wrong[0].contains(word),
            "{files:?} should draw one complaint with {word:?}, draws {wrong:?}"
        );
    }
}

#[test]
fn a_wrong_door_is_noticed() {
    let good: &[File] = &[
        ("src/passes/a.rs", "use crate::twins::rays::Push;\n// use crate::scene::View;"),
        ("src/scene/b.rs", "use crate::{error::Error, volume::Size3};\nlet a = \"crate::gpu\";"),
        ("src/lib.rs", "pub mod passes;"),
    ];
    assert_eq!(rooms(good), Vec::<String>::new());
    draws(
        rooms,
        &[
            (&[("src/scene/a.rs", "use crate::gpu::Gpu;")], "may not use \"gpu\""),
            (&[("src/reference/a.rs", "fn f(t: crate::twins::T) {}")], "may not use \"twins\""),
            (&[("src/gpu/a.rs", "use crate::{error::Error, volume::Size3};")], "\"volume\""),
            (
                &[("src/scene/a.rs", "use crate::{\n    error::{Exit, Error},\n    gpu,\n};")],
                "\"gpu\"",
            ),
            (&[("src/import/a.rs", "    let a = \"\\\"\"; crate::scene::f();")], "\"scene\""),
            (&[("src/volume/a.rs", "use crate::Result;")], "no room"),
            (&[("src/helpers/a.rs", "")], "not in the table"),
            (&[("src/helpers.rs", "")], "not in the table"),
            (&[("src/twins/a.rs", "use rayon::prelude::*;")], "crate rayon"),
            (&[("src/render/a.rs", "use ash::vk;")], "crate ash"),
        ],
    );
}

#[test]
fn a_broken_mirror_is_noticed() {
    let good: &[File] = &[
        ("shaders/a.comp", "A"),
        ("shaders/common/b.glsl", "B"),
        ("src/passes/a.rs", ""),
        ("src/passes/mod.rs", ""),
        ("src/twins/a.rs", ""),
        ("src/twins/b.rs", ""),
    ];
    let sources: &[File] = &[("a.comp", "A"), ("common/b.glsl", "B")];
    assert_eq!(mirror(good, sources), Vec::<String>::new());
    for (missing, word) in [(2, "src/passes/a.rs"), (4, "src/twins/a.rs"), (5, "src/twins/b.rs")] {
        let files: Vec<File> = [&good[..missing], &good[missing + 1..]].concat();
        draws(|files| mirror(files, sources), &[(&files, word)]);
    }
    for (more, word) in [
        (("src/passes/c.rs", ""), "no shader"),
        (("src/twins/c.rs", ""), "no shader"),
        (("shaders/notes.txt", ""), "SOURCES"),
    ] {
        draws(|files| mirror(files, sources), &[(&[good, &[more]].concat(), word)]);
    }
    draws(|files| mirror(files, &[("a.comp", "A"), ("common/b.glsl", "C")]), &[(good, "another")]);
}

#[test]
fn unsafe_code_is_noticed() {
    let keyword = concat!("un", "safe");
    let block = format!(
        "fn f() {{\n    // SAFETY: the caller's.\n    let a =\n        {keyword} {{ g() }};\n}}"
    );
    assert_eq!(unsafe_code(&[("src/gpu/a.rs", &block)]), Vec::<String>::new());
    assert_eq!(
        unsafe_code(&[("src/render/a.rs", &format!("// {keyword}\nlet a = \"{keyword}\";\n"))]),
        Vec::<String>::new()
    );
    let bare = format!("    // SAFETY: of another.\n    h();\n    {keyword} {{ g() }}");
    draws(
        unsafe_code,
        &[
            (&[("src/render/a.rs", &block)], "outside src/gpu/"),
            (&[("tests/a.rs", &block)], "outside src/gpu/"),
            (&[("src/gpu/a.rs", &bare)], "SAFETY"),
        ],
    );
}

#[test]
fn banned_words_are_noticed() {
    let good = format!("{}(#12) and {}: issue 7\nin sync", UNFINISHED[0], UNFINISHED[1]);
    let good = good.replace(": issue", " issue");
    assert_eq!(banned(&[("a.md", &good)]), Vec::<String>::new());
    for (phrase, _) in BANNED {
        draws(banned, &[(&[("docs/a.md", &format!("see {phrase}x"))], phrase)]);
    }
    for word in UNFINISHED {
        draws(banned, &[(&[("src/a.rs", &format!("// {word}: later"))], "a place to look")]);
    }
}

#[test]
fn unequal_limits_are_noticed() {
    let rust = "pub const A: u32 = 32;\npub const B: f32 = 1.0e6;\n";
    assert_eq!(limits("#define A 32u\n#define B 1.0e6 // b", rust), Vec::<String>::new());
    for (glsl, word) in [
        ("#define A 33u\n#define B 1.0e6", "33"),
        ("#define A 32u", "limits.glsl lacks B"),
        ("#define A 32u\n#define B 1e6\n#define C 1", "limits.rs lacks C"),
        ("#define A 32u\n#define B (A * 2)", "not one number"),
    ] {
        draws(|_| limits(glsl, rust), &[(&[], word)]);
    }
}

#[test]
fn bad_first_lines_and_long_files_are_noticed() {
    draws(
        first_lines,
        &[
            (&[("src/a.rs", "use std::fs;\n")], "`//!`"),
            (&[("src/a.rs", "//! No sentence\n\n")], "`//!`"),
            (&[("shaders/a.comp", "// b.comp: something else\n")], "// a.comp: "),
            (&[("shaders/common/a.glsl", "#version 460\n")], "// a.glsl: "),
        ],
    );
    let good: &[File] = &[("src/a.rs", "//! Two lines of\n//! one sentence.\n")];
    assert_eq!(first_lines(good), Vec::<String>::new());
    let long = "\n".repeat(LINES_MAX + 1);
    let listed: Vec<File> = LONG_FILES.iter().map(|(path, _)| (*path, &long[..])).collect();
    assert_eq!(lengths(&listed), Vec::<String>::new());
    draws(lengths, &[(&[&listed[..], &[("src/a.rs", &long[..])]].concat(), "601 lines")]);
    draws(lengths, &[(&listed[1..], "take it out")]);
    let short = [&listed[1..], &[(LONG_FILES[0].0, "")]].concat();
    draws(lengths, &[(&short, "no longer long")]);
}
