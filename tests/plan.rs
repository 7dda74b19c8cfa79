//! The plan against what is really created, over scenes drawn directly: objects, bytes, dispatches.
//! The whole ladder of features is climbed in `ladder.rs`.

mod common;

use ashfall::render::{Layout, LayoutChoice, Plan, Settings};
use ashfall::scene::Overrides;
use common::created::assert_as_planned;
use common::drawing::{Device, scene_data};

/// A scene of the ladder: volume, channel table rows, settings.
struct Rung {
    name: &'static str,
    text: String,
    settings: Settings,
}

fn scene(source: &str, window: f64, early_stop: f64, size: [u32; 2], views: usize) -> String {
    let mut text = format!(
        r#"
format = 1
[picture]
size = [{}, {}]
[quality]
early_stop = {early_stop}
[[volume]]
source = {source}
[[volume.channel]]
window = [0.0, {window}]
transfer = [
  {{ at = 0.0, color = [0.2, 0.2, 0.2], extinction = 0.0 }},
  {{ at = 1.0, color = [1.0, 1.0, 1.0], extinction = 0.5 }},
]
"#,
        size[0], size[1]
    );
    for view in 0..views {
        text += &format!(
            "[[view]]\nname = \"v{view}\"\neye = [{view}.5, 2.5, -20.0]\ntarget = [4.0, 4.0, 4.0]\nup = [0.0, 1.0, 0.0]\nfov_degrees = 30.0\n"
        );
    }
    text
}

fn ladder() -> Vec<Rung> {
    let auto = Settings::default();
    let plain = Settings { layout: LayoutChoice::Only(Layout::Plain), ..auto };
    let staged = Settings { steps_per_dispatch: 32, tile: [24, 24], ..plain };
    let volume = |kind: &str, edge: u32| {
        format!("{{ computed = \"{kind}\", size = [{edge}, {edge}, {edge}] }}")
    };
    let (constant, ramp, big) = (volume("constant", 4), volume("ramp", 8), volume("hydrogen", 96));
    let rung = |name, text, settings| Rung { name, text, settings };
    vec![
        rung("constant", scene(&constant, 1.0, 0.0, [16, 16], 1), plain),
        rung("one channel", scene(&ramp, 1.0, 0.0, [16, 16], 1), plain),
        rung("early stop", scene(&ramp, 1.0, 0.001, [16, 16], 1), plain),
        rung("quads", scene(&ramp, 1.0, 0.001, [16, 16], 1), auto),
        rung("staged, tiled, two views", scene(&ramp, 1.0, 0.001, [40, 30], 2), staged),
        rung("many uploads", scene(&big, 255.0, 0.001, [40, 30], 2), staged),
    ]
}

fn measured(device: &Device, rung: &Rung) -> Plan {
    let small_staging = Overrides { staging_mib: Some(1), ..Overrides::default() };
    let data = scene_data(&rung.text, &small_staging);
    let mut renderer = device.renderer(&data, &rung.settings);
    for view in 0..data.scene.views.len() {
        renderer.draw(view, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
    }
    let plan = renderer.plan().clone();
    for pass in &plan.passes {
        let recorded = renderer.records().iter().flat_map(|record| &record.steps);
        let of_pass = recorded.filter(|step| step.label == pass.name).count() as u32;
        assert_eq!(of_pass, pass.dispatches_per_tile * plan.tiles, "{}: {}", rung.name, pass.name);
    }
    assert_as_planned(device, &plan, rung.name);
    plan
}

#[test]
fn a_renderer_creates_what_the_plan_lists_and_nothing_else() {
    let mut rungs: Vec<(&str, Plan)> = Vec::new();
    for rung in ladder() {
        // A device of its own, so that everything counted belongs to this rung.
        let Some(device) = Device::open() else { return };
        let plan = measured(&device, &rung);
        println!(
            "{:<26} {:>3} objects, {:>9} bytes, {:>4} instructions",
            rung.name,
            plan.objects.values().sum::<u64>(),
            plan.memory_bytes,
            instructions(&plan)
        );
        rungs.push((rung.name, plan));
        device.finish();
    }
    for pair in rungs.windows(2) {
        let objects = |plan: &Plan| plan.objects.values().sum::<u64>();
        let (less, more) = (&pair[0], &pair[1]);
        assert!(objects(&less.1) <= objects(&more.1), "{} against {}", less.0, more.0);
    }
    for pair in rungs[..3].windows(2) {
        let (less, more) = (&pair[0], &pair[1]);
        assert!(instructions(&less.1) < instructions(&more.1), "{} against {}", less.0, more.0);
    }
}

fn instructions(plan: &Plan) -> u32 {
    plan.passes.iter().map(|pass| pass.spirv_instructions).sum()
}

#[test]
fn the_plainest_scene_binds_nothing_it_does_not_read() {
    let Some(device) = Device::open() else { return };
    let rung = &ladder()[0];
    let plan = device.plan(&scene_data(&rung.text, &Overrides::default()), &rung.settings);
    let passes: Vec<_> = plan.passes.iter().map(|pass| pass.name).collect();
    assert_eq!(passes, ["cast"]);
    assert_eq!(plan.passes[0].bindings.len(), 4, "{:?}", plan.passes[0].bindings);
    for binding in ["views", "transfer", "picture", "counters"] {
        assert!(plan.passes[0].bindings.iter().any(|b| b == binding), "{binding}");
    }
    for kind in ["image", "image_view", "sampler"] {
        assert!(!plan.objects.contains_key(kind), "{kind} in {:?}", plan.objects);
    }
    assert_eq!(plan.objects["semaphore"], 1, "no transfer role");
    assert_eq!(plan.atlas_bytes, 0);
    let shader = device.compiler.compile(&ashfall::passes::cast::variant(
        &ashfall::passes::march_shape::Shape {
            channels: vec![ashfall::passes::march_shape::ChannelShape::Constant],
            filter: ashfall::passes::march_shape::FilterShape::Fetch,
            early_stop: false,
            preintegrated: false,
            macrocells: ashfall::passes::march_shape::MacrocellUse::Unused,
            nan_voxels: false,
            sample_every: Vec::new(),
        },
        1,
    ));
    let shader = shader.unwrap_or_else(|why| panic!("{why}"));
    assert_eq!(shader.spirv.len(), plan.passes[0].spirv_words, "the plan's SPIR-V is the real one");
    device.finish();
}
