//! Validation with synchronization checks watches every test; here it must also catch a fault.

mod common;

use ashfall::gpu::{Access, Buffer, BufferSpec, ComputePipeline, MemoryHome, Recorder, RoleKind};
use ashfall::passes::{rays, resolve};
use ashfall::render::Settings;
use ashfall::scene::Overrides;
use ashfall::twins::ray::{RayGeometry, RayState};
use ashfall::twins::ray_setup::ViewRays;
use ashfall::twins::rays::Push;
use common::drawing::{Device, computed_scene};

const TILE: [u32; 2] = [16, 16];

/// Rays, then resolve, which reads the states that rays wrote; with or without the barrier between.
fn rays_then_resolve(device: &Device, fault: bool) -> usize {
    let gpu = &device.gpu;
    let rays_count = u64::from(TILE[0] * TILE[1]);
    let buffer = |name, bytes, home| {
        Buffer::new(gpu, &BufferSpec { name, bytes, home }).unwrap_or_else(|why| panic!("{why}"))
    };
    let pipeline = |variant| {
        let shader = device.compiler.compile(&variant).unwrap_or_else(|why| panic!("{why}"));
        ComputePipeline::new(gpu, shader).unwrap_or_else(|why| panic!("{why}"))
    };
    let views = buffer("views", size_of::<ViewRays>() as u64, MemoryHome::Upload);
    views.write(0, bytemuck::bytes_of(&ViewRays::default())).unwrap_or_else(|why| panic!("{why}"));
    let state_bytes = rays_count * size_of::<RayState>() as u64;
    let geometry_bytes = rays_count * size_of::<RayGeometry>() as u64;
    let ray_geometry = buffer("ray_geometry", geometry_bytes, MemoryHome::Device);
    let ray_state = buffer("ray_state", state_bytes, MemoryHome::Device);
    let picture = buffer("picture", rays_count * 16, MemoryHome::Readback);
    let counters = buffer("counters", 8, MemoryHome::Readback);
    let (set_up, resolved) = (pipeline(rays::variant(1)), pipeline(resolve::variant()));
    let mut recorder = Recorder::new(gpu, RoleKind::Render, None);
    let push = Push {
        tile_origin_pixel: [0, 0],
        tile_size_pixel: TILE,
        volume_size: [4; 3],
        view: 0,
        step_world: 1.0,
    };
    let resources =
        rays::Resources { views: &views, ray_geometry: &ray_geometry, ray_state: &ray_state };
    rays::record(&mut recorder, &set_up, &resources, &push);
    let push = resolve::Push { background: [0.0; 3], unused_0: 0, tile_size_pixel: TILE };
    let resources = resolve::Resources {
        ray_state: &ray_state,
        picture: &picture,
        counters: &counters,
        states: None,
    };
    resolve::record(&mut recorder, &resolved, &resources, &push);
    if fault {
        recorder.leave_out_barriers_before("resolve");
    }
    let before = gpu.messages().len();
    let submitted = recorder.submit(&[]).unwrap_or_else(|why| panic!("{why}"));
    gpu.wait(submitted.point).unwrap_or_else(|why| panic!("{why}"));
    let said = gpu.messages().split_off(before);
    for message in &said {
        assert!(message.text.contains("SYNC-HAZARD"), "another message: {}", message.text);
    }
    said.len()
}

#[test]
fn a_missing_barrier_is_caught_and_the_recorders_own_is_enough() {
    let Some(device) = Device::open() else { return };
    assert_eq!(rays_then_resolve(&device, false), 0, "the recorder's barriers");
    assert!(rays_then_resolve(&device, true) > 0, "the planted fault is not noticed");
}

#[test]
fn barriers_stand_where_data_flows_and_nowhere_else() {
    let Some(device) = Device::open() else { return };
    let overrides = Overrides { size: Some([32, 32]), ..Overrides::default() };
    let data = computed_scene("marschner-lobb", [24, 24, 24], &overrides);
    let settings = Settings { steps_per_dispatch: 32, ..Settings::default() };
    let mut renderer = device.renderer(&data, &settings);
    renderer.draw(0, &mut |_| {}).unwrap_or_else(|why| panic!("{why}"));
    let steps: Vec<_> = renderer.records().iter().flat_map(|record| record.steps.clone()).collect();
    let labels: Vec<_> = steps.iter().map(|step| step.label).collect();
    assert_eq!(labels.first(), Some(&"rays"));
    assert_eq!(labels[labels.len() - 3..], ["resolve", "host_read", "host_read"]);
    assert!(steps[0].barriers.is_empty(), "nothing was written before: {:?}", steps[0].barriers);
    for pair in steps.windows(2) {
        let written = |name: &str| {
            pair[0].accesses.iter().any(|(resource, access)| *resource == name && access.writes())
        };
        for (resource, access) in &pair[1].accesses {
            let guarded = pair[1].barriers.iter().any(|(name, _)| name == resource);
            if written(resource) {
                assert!(guarded, "{} {resource} without a barrier", pair[1].label);
            }
            if matches!(access, Access::UniformRead | Access::ShaderSample) {
                assert!(!guarded, "{} {resource} with a needless barrier", pair[1].label);
            }
        }
    }
    device.finish();
}
