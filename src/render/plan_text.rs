//! A plan as people read it.

use std::fmt;

use crate::render::plan::Plan;

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        writeln!(f, "device     {} ({})", self.device, self.driver)?;
        writeln!(f, "queues     {}", self.queues)?;
        writeln!(
            f,
            "picture    {} x {} in {} tile(s) of {} x {}, views: {}",
            self.picture[0],
            self.picture[1],
            self.tiles,
            self.tile[0],
            self.tile[1],
            self.views.join(", ")
        )?;
        match self.step_world {
            Some(step) => writeln!(
                f,
                "rays       step at most {step} world units, at most {} samples a ray",
                self.samples_of_ray_max
            )?,
            None => writeln!(f, "rays       one sample each: the medium is homogeneous")?,
        }
        writeln!(
            f,
            "memory     {:.2} MiB, of which voxels {:.2} MiB ({} addressing)",
            mib(self.memory_bytes),
            mib(self.atlas_bytes),
            self.addressing
        )?;
        if let Some(octree) = &self.octree {
            writeln!(
                f,
                "octree     {} leaves of {} x {} x {} voxels, {} channel(s) in words of {} bits: {:.2} MiB, and {:.2} MiB of ram_mib",
                octree.leaves,
                octree.leaf[0],
                octree.leaf[1],
                octree.leaf[2],
                octree.channels,
                octree.word_bits,
                mib(octree.device_bytes),
                mib(octree.host_bytes)
            )?;
        }
        if let Some(layout) = &self.layout {
            writeln!(f, "layout     {}: {}", layout.chosen, layout.why)?;
            for cost in &layout.costs {
                write!(f, "  {:<8} voxels {:.2} MiB", cost.layout, mib(cost.voxel_bytes))?;
                if let Some(slots) = cost.slots {
                    write!(f, " ({slots} slots)")?;
                }
                if let Some(ns) = cost.sample_ns {
                    write!(f, ", {ns:.1} ns a sample")?;
                }
                writeln!(f)?;
            }
        }
        writeln!(f, "\npasses")?;
        for pass in &self.passes {
            writeln!(
                f,
                "  {:<9} x {:<3} {:>5} instructions, {:>6} bytes of SPIR-V, binds {}",
                pass.name,
                pass.dispatches_per_tile,
                pass.spirv_instructions,
                pass.spirv_words * 4,
                pass.bindings.join(", ")
            )?;
            for (name, value) in &pass.defines {
                writeln!(f, "            {name} = {value}")?;
            }
        }
        writeln!(f, "\nbuffers")?;
        for buffer in &self.buffers {
            writeln!(
                f,
                "  {:<15} {:>12} bytes, {:>12} of memory, {}",
                buffer.name, buffer.bytes, buffer.memory_bytes, buffer.home
            )?;
        }
        if !self.images.is_empty() {
            writeln!(f, "\nimages")?;
        }
        for image in &self.images {
            let [x, y, z] = image.size;
            writeln!(
                f,
                "  {:<15} {x} x {y} x {z} {} ({}), {} bytes of memory",
                image.name, image.format, image.layout, image.memory_bytes
            )?;
        }
        writeln!(f, "\nobjects")?;
        for (kind, count) in &self.objects {
            writeln!(f, "  {kind:<22} {count}")?;
        }
        writeln!(f, "\nleft out")?;
        for (what, why) in &self.left_out {
            writeln!(f, "  {what}: {why}")?;
        }
        Ok(())
    }
}
