//! A view drawn by the built binary, and what its statistics must say.

use std::path::Path;

use serde_json::Value;

use crate::binary::ashfall;

/// Uploads for each brick that rays need, at most.
const FACTOR_MAX: f64 = 1.02;
/// Atlas and cache of 256 MiB each, and as much again for all else.
const RSS_BYTES_MAX: u64 = 900_000_000;

/// Statistics of one view.
pub struct Drawn(Value);

impl Drawn {
    /// Draws one view of a scene into a picture beside it, with `flags`.
    pub fn of(scene: &Path, view: &str, flags: &[&str]) -> Drawn {
        let picture = scene.with_extension("png");
        let [scene, picture] = [scene, &picture].map(|path| path.to_str().expect("UTF-8"));
        let run =
            ashfall(["render", scene, "-o", picture, "--view", view, "--json"].iter().chain(flags));
        assert_eq!(run.code, Some(0), "{view}: {}", run.stderr);
        let results: Value = serde_json::from_str(&run.stdout).expect("JSON");
        Drawn(results["views"][0].clone())
    }

    /// A count.
    pub fn number(&self, name: &str) -> u64 {
        self.0[name].as_u64().unwrap_or_else(|| panic!("{name} in {}", self.0))
    }

    /// Bricks uploaded by level, 0 first.
    pub fn by_level(&self) -> Vec<u64> {
        let levels = self.0["bricks_uploaded_by_level"].as_array().expect("a list");
        levels.iter().map(|count| count.as_u64().expect("a count")).collect()
    }

    /// Finished, each brick loaded about once, within memory.
    pub fn check(&self) {
        let said = &self.0;
        assert_eq!(said["converged"], true, "{said}");
        assert_eq!(self.number("bricks_failed"), 0, "{said}");
        let (needed, uploaded) = (self.number("bricks_needed"), self.number("bricks_uploaded"));
        assert!(needed > 0, "something is seen: {said}");
        assert!(uploaded as f64 <= needed as f64 * FACTOR_MAX, "{uploaded} for {needed}: {said}");
        let rss = self.number("peak_rss_bytes");
        assert!(rss < RSS_BYTES_MAX, "{rss} bytes resident: {said}");
    }

    /// The figures, for one line.
    pub fn figures(&self) -> String {
        format!(
            "{} bricks needed, {} uploaded (by level {:?}, {:.0} MB), {} rounds, {:.1} s, {:.0} MB resident at most",
            self.number("bricks_needed"),
            self.number("bricks_uploaded"),
            self.by_level(),
            self.number("bytes_uploaded") as f64 * 1e-6,
            self.number("rounds"),
            self.0["wall_ms"].as_f64().expect("a time") * 1e-3,
            self.number("peak_rss_bytes") as f64 * 1e-6,
        )
    }
}
