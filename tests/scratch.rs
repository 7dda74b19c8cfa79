use ashfall::gpu::*;
use ashfall::render::paging::{PagingSettings, Traversal};
use ashfall::render::*;
use ashfall::scene::Overrides;
use ashfall::study::repeated::Timer;
use ashfall::study::resident_frames::*;
use std::path::{Path, PathBuf};
mod common;
use common::drawing::Device;

fn sources() -> &'static ShaderSources {
    let mut all: Vec<(&'static str, &'static str)> = Vec::new();
    for (name, _) in ashfall::passes::SOURCES {
        let text = std::fs::read_to_string(PathBuf::from("shaders").join(name)).unwrap();
        all.push((name, text.leak()));
    }
    all.leak()
}

#[test]
fn scratch() {
    let device = Device::open().unwrap();
    let compiler = ShaderCompiler::new(sources(), None);
    let scenes = std::env::var("SCENE").unwrap();
    let repeats: u32 = std::env::var("REPEATS").ok().map_or(5, |r| r.parse().unwrap());
    for scene in scenes.split(',') {
        let overrides = Overrides { size: Some([384, 384]), ..Overrides::default() };
        let data = match scene {
            "sparse" => ashfall::study::bench_scenes::sparse(512, 32, &overrides).unwrap(),
            "dense" => ashfall::study::bench_scenes::dense(256, 32, &overrides).unwrap(),
            "four" => ashfall::study::bench_scenes::four_channels(128, 32, &overrides).unwrap(),
            _ => ashfall::cli::load_scene(Path::new(scene), &overrides).unwrap(),
        };
        let mut ways = Vec::new();
        let mut names = Vec::new();
        let mut pictures = Vec::new();
        let mut add = |name: &str, addressing, traversal, leaf| {
            let settings = Settings {
                addressing,
                paging: PagingSettings { traversal, leaf: [leaf; 3], ..PagingSettings::default() },
                ..Settings::default()
            };
            match ResidentScene::new(&device.gpu, &compiler, &data, &settings.checked().unwrap()) {
                Ok((way, picture)) => {
                    ways.push(way);
                    names.push(name.to_owned());
                    pictures.push(picture.pixels);
                }
                Err(why) => println!("{name}: {why:?}"),
            }
        };

        add("page-table", Addressing::Paged, Traversal::PageTable, 4);
        for leaf in [4, 8] {
            add(&format!("octree {leaf}"), Addressing::Paged, Traversal::ResidencyOctree, leaf);
        }
        draw_in_turns(&mut ways, Timer::of(&device.gpu), repeats, || {}).unwrap();
        let march = |way: &ResidentScene| {
            let mut ms = way.frames_ms();
            ms.sort_by(f64::total_cmp);
            ms[ms.len() / 2]
        };
        let base = march(&ways[0]);
        println!("== {scene}");
        for (i, (a, b)) in
            pictures[1].iter().zip(&pictures[0]).enumerate().filter(|(_, (a, b))| a != b).take(60)
        {
            println!("octree pixel {} {} {a:?} {b:?}", i % 384, i / 384);
        }
        for ((way, name), picture) in ways.iter().zip(&names).zip(&pictures) {
            let m = march(way);
            println!(
                "{name:<14} {m:8.1} ms  {:5.2}  {:7.2} Msamples  needed {:5} same {} differ {} most {:e}",
                m / base,
                way.samples() as f64 * 1e-6,
                way.first.bricks_needed,
                *picture == pictures[0],
                picture.iter().zip(&pictures[0]).filter(|(a, b)| a != b).count(),
                picture
                    .iter()
                    .zip(&pictures[0])
                    .flat_map(|(a, b)| (0..4).map(move |i| (a[i] - b[i]).abs()))
                    .fold(0.0f32, f32::max)
            );
        }
    }
    device.finish();
}
