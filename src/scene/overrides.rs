//! Command-line flags that win over the scene file.

/// One optional value for each key of `[picture]`, `[quality]` and `[memory]`.
///
/// Values are checked with the scene: a bad one is reported at its flag.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// `--size`
    pub size: Option<[u32; 2]>,
    /// `--background`
    pub background: Option<[f64; 3]>,
    /// `--integrator`
    pub integrator: Option<String>,
    /// `--step`
    pub step: Option<f64>,
    /// `--tolerance`
    pub tolerance: Option<f64>,
    /// `--filter`
    pub filter: Option<String>,
    /// `--refine`
    pub refine: Option<String>,
    /// `--level-max`
    pub level_max: Option<i64>,
    /// `--level-loss`
    pub level_loss: Option<f64>,
    /// `--early-stop`
    pub early_stop: Option<f64>,
    /// `--atlas-mib`
    pub atlas_mib: Option<i64>,
    /// `--ram-mib`
    pub ram_mib: Option<i64>,
    /// `--staging-mib`
    pub staging_mib: Option<i64>,
}
