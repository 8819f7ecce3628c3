//! Scenes and sizes of the benches that run engines in this process.

use crate::study::ways::Case;
use clap::Args;
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::scene::SceneName;

/// Most pairs of a scene where all boxes overlap: larger ones are left out.
const MOST_QUADRATIC_PAIRS: u64 = 10_000_000;

/// The scenes and their sizes.
#[derive(Clone, Debug, Args)]
pub struct SceneSizes {
    /// Scenes, as `pairmaskd scene` names them [default: see above]
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    scene: Vec<SceneName>,
    /// Numbers of boxes [default: see above]
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',')]
    n: Vec<u32>,
}

impl SceneSizes {
    /// Whether neither scenes nor sizes are named.
    pub fn is_default(&self) -> bool {
        self.scene.is_empty() && self.n.is_empty()
    }

    /// Every scene in every size. Scenes whose pairs grow with the square of n are left out at
    /// sizes with more than [`MOST_QUADRATIC_PAIRS`].
    pub fn cases(&self, scenes: &[SceneName], sizes: &[u32]) -> Vec<Case> {
        let scenes = if self.scene.is_empty() { scenes } else { &self.scene };
        let sizes = if self.n.is_empty() { sizes } else { &self.n };
        let cases = scenes
            .iter()
            .flat_map(|scene| sizes.iter().map(|n| Case { scene: *scene, n: *n as usize }));
        let pairs = |case: &Case| pairmask_core::BoxCount::new(case.n as u32).pair_count();
        cases
            .filter(|case| !case.scene.is_quadratic() || pairs(case) <= MOST_QUADRATIC_PAIRS)
            .collect()
    }
}
