//! `--layout auto`: chosen by what a sample costs on the device, measured only where the scene leaves a
//! choice, and no byte of a picture depends on it.

mod binary;
mod common;

use std::cell::Cell;

use ashfall::render::{
    Addressing, Layout, LayoutChoice, LayoutPrices, Plan, PlannedLayout, Renderer, SceneData,
    Settings,
};
use ashfall::scene::{Overrides, Scene};
use ashfall::study::layout_price;
use ashfall::volume::{ChannelVoxels, Size3, VolumeVoxels, VoxelFormat, Voxels, WorldFromVoxel};
use binary::ashfall;
use common::created::assert_as_planned;
use common::drawing::{Device, computed_scene, dense};

const CHEAP_QUADS: LayoutPrices = LayoutPrices { plain_ns: 20.0, quads_ns: 5.0 };
const DEAR_QUADS: LayoutPrices = LayoutPrices { plain_ns: 20.0, quads_ns: 19.0 };

/// Plain it fits 1 MiB, in quads it does not.
fn cloud(overrides: &Overrides) -> SceneData {
    let overrides = Overrides { size: Some([40, 30]), level_max: Some(0), ..overrides.clone() };
    computed_scene("hydrogen", [72, 64, 60], &overrides)
}

fn of(addressing: Addressing, layout: LayoutChoice) -> Settings {
    Settings { addressing, layout, ..Settings::default() }
}

fn layout(plan: &Plan) -> &PlannedLayout {
    plan.layout.as_ref().expect("voxels lie somehow")
}

/// A plan for these prices, and how often they were asked for.
fn metered(
    device: &Device,
    data: &SceneData,
    settings: &Settings,
    prices: Option<LayoutPrices>,
) -> (Plan, u32) {
    let asked = Cell::new(0);
    let meter = |_: VoxelFormat| {
        asked.set(asked.get() + 1);
        Ok(prices)
    };
    let plan = Plan::metered(&device.gpu, &device.compiler, data, settings, &meter);
    (plan.unwrap_or_else(|why| panic!("{why}")), asked.get())
}

#[test]
fn prices_choose_and_no_byte_depends_on_them() {
    for addressing in [Addressing::Direct, Addressing::Paged] {
        let mut pictures = Vec::new();
        for (prices, expected) in
            [(Some(CHEAP_QUADS), "quads"), (Some(DEAR_QUADS), "plain"), (None, "quads")]
        {
            // A device of its own, so that everything counted belongs to this plan.
            let Some(device) = Device::open() else { return };
            let data = cloud(&Overrides::default());
            let settings = of(addressing, LayoutChoice::Auto);
            let (plan, asked) = metered(&device, &data, &settings, prices);
            assert_eq!(asked, 1, "{addressing:?}");
            let layout = layout(&plan);
            assert_eq!(layout.chosen, expected, "{addressing:?} {prices:?}: {}", layout.why);
            assert!(plan.images[0].layout == expected, "{addressing:?}: as it is made");
            let [plain, quads] = &layout.costs[..] else { panic!("two layouts: {layout:?}") };
            let voxels = 72 * 64 * 60;
            assert!(plain.voxel_bytes >= voxels && quads.voxel_bytes >= 4 * voxels, "{layout:?}");
            assert!(plain.voxel_bytes < quads.voxel_bytes, "{layout:?}");
            assert_eq!(plain.sample_ns, prices.map(|prices| prices.plain_ns));
            assert_eq!(quads.sample_ns, prices.map(|prices| prices.quads_ns));
            let chosen = layout.costs.iter().find(|cost| cost.layout == expected);
            assert_eq!(chosen.map(|cost| cost.voxel_bytes), Some(plan.atlas_bytes));
            let mut renderer = Renderer::new(&device.gpu, plan.clone(), &data)
                .unwrap_or_else(|why| panic!("{why}"));
            let (picture, statistics) =
                renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
            assert!(statistics.converged, "{addressing:?}");
            assert_as_planned(&device, &plan, expected);
            pictures.push(picture.pixels);
            drop(renderer);
            device.finish();
        }
        assert!(pictures[0] == pictures[1] && pictures[1] == pictures[2], "{addressing:?}");
    }
}

#[test]
fn prices_are_asked_for_only_where_nothing_else_decides() {
    let Some(device) = Device::open() else { return };
    let small = Overrides { atlas_mib: Some(1), ..Overrides::default() };
    let hardware = Overrides { filter: Some("hardware".to_owned()), ..Overrides::default() };
    let auto = |addressing| of(addressing, LayoutChoice::Auto);
    let only = |layout| of(Addressing::Auto, LayoutChoice::Only(layout));
    for (data, settings, chosen, why) in [
        (cloud(&Overrides::default()), only(Layout::Plain), "plain", "--layout plain"),
        (cloud(&Overrides::default()), only(Layout::Quads), "quads", "--layout quads"),
        (cloud(&hardware), auto(Addressing::Direct), "plain", "filter \"exact\""),
        (cloud(&hardware), auto(Addressing::Paged), "plain", "filter \"exact\""),
        (cloud(&small), auto(Addressing::Direct), "plain", "atlas_mib"),
        (cloud(&small), auto(Addressing::Paged), "plain", "atlas_mib"),
    ] {
        let (plan, asked) = metered(&device, &data, &settings, Some(CHEAP_QUADS));
        let layout = layout(&plan);
        assert_eq!((asked, layout.chosen), (0, chosen), "{settings:?}: {}", layout.why);
        assert!(layout.why.contains(why), "{}", layout.why);
        assert!(layout.costs.iter().all(|cost| cost.sample_ns.is_none()));
    }
    let constant = computed_scene("constant", [8; 3], &Overrides::default());
    let (plan, asked) = metered(&device, &constant, &auto(Addressing::Direct), Some(CHEAP_QUADS));
    assert_eq!((asked, plan.layout), (0, None), "no image, no layout");
    device.finish();
}

#[test]
fn a_measurement_leaves_nothing_and_is_made_once() {
    let Some(device) = Device::open() else { return };
    let data = cloud(&Overrides::default());
    let planned = |settings: &Settings| {
        layout_price::plan(&device.gpu, &device.compiler, &data, settings)
            .unwrap_or_else(|why| panic!("{why}"))
    };
    let created = || device.gpu.census.counts();
    for layout in [Layout::Plain, Layout::Quads] {
        planned(&of(Addressing::Auto, LayoutChoice::Only(layout)));
        assert!(created().is_empty(), "{layout:?}: nothing is measured");
    }
    let start = std::time::Instant::now();
    let plan = planned(&of(Addressing::Direct, LayoutChoice::Auto));
    println!("planned in {:.1?}: {}", start.elapsed(), layout(&plan).why);
    let measured = created();
    assert!(!measured.is_empty(), "measured on the device");
    assert_eq!(device.gpu.ledger.bytes(), 0, "all memory is given back");
    let again = planned(&of(Addressing::Paged, LayoutChoice::Auto));
    assert_eq!(created(), measured, "the second plan knows");
    for plan in [&plan, &again] {
        let layout = layout(plan);
        assert!(layout.costs.iter().all(|cost| cost.sample_ns.is_some_and(|ns| ns > 0.0)));
        if device.gpu.facts().driver.contains("llvmpipe") {
            assert_eq!(layout.chosen, "quads", "{}", layout.why);
        }
    }
    device.finish();
}

#[test]
fn channels_are_priced_in_their_widest_format() {
    let Some(device) = Device::open() else { return };
    let channel = "[[volume.channel]]\nwindow = [0.0, 1.0]\ntransfer = [\n  \
        { at = 0.0, color = [0.2, 0.2, 0.2], extinction = 0.0 },\n  \
        { at = 1.0, color = [1.0, 1.0, 1.0], extinction = 0.5 },\n]\n";
    let text = format!(
        "format = 1\n[[volume]]\nsource = \"in memory\"\n{channel}{channel}\
         [[view]]\neye = [0.5, 2.5, -20.0]\ntarget = [1.0, 1.0, 1.0]\nup = [0.0, 1.0, 0.0]\n\
         fov_degrees = 30.0\n"
    );
    let scene = Scene::from_toml(&text, "test.toml".as_ref(), &Overrides::default())
        .unwrap_or_else(|why| panic!("{why}"));
    let of = |voxels| ChannelVoxels { voxels, slope: 1.0, intercept: 0.0 };
    let volume = VolumeVoxels {
        size: Size3::cube(2),
        world_from_voxel: WorldFromVoxel::from_spacing([1.0; 3]).expect("a place"),
        channels: vec![of(Voxels::U8((0..8).collect())), of(Voxels::I16((0..8).collect()))],
    };
    let data = SceneData::new(scene, vec![dense(volume)]).unwrap_or_else(|why| panic!("{why}"));
    for addressing in [Addressing::Direct, Addressing::Paged] {
        let asked = Cell::new(None);
        let meter = |format| {
            asked.set(Some(format));
            Ok(Some(CHEAP_QUADS))
        };
        let settings = self::of(addressing, LayoutChoice::Auto);
        Plan::metered(&device.gpu, &device.compiler, &data, &settings, &meter)
            .unwrap_or_else(|why| panic!("{why}"));
        assert_eq!(asked.get(), Some(VoxelFormat::I16), "{addressing:?}");
    }
    device.finish();
}

/// As people and programs read it.
#[test]
fn a_printed_plan_says_what_each_layout_costs() {
    if Device::open().is_none() {
        return;
    }
    let store = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/version_1_u8.bricks");
    let plan = |flags: &[&str]| {
        let run = ashfall([&["plan", store], flags].concat());
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        run.stdout
    };
    let text = plan(&[]);
    assert!(text.contains("ns a sample") && text.contains("\nlayout "), "{text}");
    let [auto, plain] = [&["--json"][..], &["--json", "--layout", "plain"]]
        .map(|flags| serde_json::from_str::<serde_json::Value>(&plan(flags)).expect("one object"));
    assert!(auto["layout"]["costs"][1]["sample_ns"].is_number(), "{}", auto["layout"]);
    assert_eq!(plain["layout"]["chosen"], "plain");
    for cost in plain["layout"]["costs"].as_array().expect("costs") {
        assert!(cost["voxel_bytes"].is_number() && cost["sample_ns"].is_null(), "{cost}");
    }
}
