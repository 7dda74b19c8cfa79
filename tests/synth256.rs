//! The reference against pictures of a program that shares no code with it.

mod truth;

use ashfall::reference::{Settings, Truth, render};
use ashfall::study::error_metrics::picture_error;

const PSNR_DB_LEAST: f64 = 90.0;

fn expected(shared: &std::path::Path, name: &str) -> Vec<[f32; 4]> {
    let file = shared.join(format!("data/synth256/reference_{name}.f32.gz"));
    let bytes = truth::unpacked(&file);
    bytes.chunks_exact(16).map(bytemuck::pod_read_unaligned).collect()
}

/// Every 61st pixel: 61 is prime to 512, so that all columns take part.
#[test]
fn every_61st_pixel_agrees() {
    let Some(shared) = truth::shared() else { return };
    for name in ["sparse", "linear"] {
        let (scene, voxels) = truth::synth256(&shared, name);
        let volumes = [(&scene.volumes[0], &voxels)];
        let truth = Truth::new(&scene.views[0], [512; 2], [0.0; 3], &volumes, 1e-9);
        let expected = expected(&shared, name);
        let (mut theirs, mut ours) = (Vec::new(), Vec::new());
        for index in (0..512 * 512).step_by(61) {
            theirs.push(expected[index]);
            ours.push(truth.pixel(index as u32 % 512, index as u32 / 512));
        }
        let error = picture_error(&theirs, &ours);
        println!("synth256 {name}: {error:?}");
        assert!(error.whole.psnr_db >= PSNR_DB_LEAST, "{name}: {error:?}");
        assert!(error.alpha_max < 1e-4, "{name}: {error:?}");
    }
}

#[test]
#[ignore = "takes half a minute; every 61st pixel is compared in the other test"]
fn whole_pictures_agree() {
    let Some(shared) = truth::shared() else { return };
    for name in ["sparse", "linear"] {
        let (scene, voxels) = truth::synth256(&shared, name);
        let volumes = [(&scene.volumes[0], &voxels)];
        for (size, threads) in [(512, 2), (256, 1)] {
            let settings = Settings { tolerance: 1e-9, threads };
            let started = std::time::Instant::now();
            let picture =
                render(&scene.views[0], [size; 2], [0.0; 3], &volumes, &settings, &|_| {});
            println!("{name} {size} x {size}, {threads} threads: {:?}", started.elapsed());
            if size == 512 {
                let error = picture_error(&expected(&shared, name), &picture.rgba);
                println!("{name}: {error:?}");
                assert!(error.whole.psnr_db >= PSNR_DB_LEAST, "{name}: {error:?}");
            }
        }
    }
}
