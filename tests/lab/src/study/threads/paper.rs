//! Figures of Avril, Gouranton and Arnaldi 2014 (§4.2, Figures 5 and 7): ms on 1, 2, 4 and 8 cores
//! of two Xeon X5482 at 3.2 GHz.

use pairmaskd::scene::SceneName;

use super::Stage;

/// The paper's numbers of cores.
pub const CORES: [usize; 4] = [1, 2, 4, 8];

/// One scene of the paper.
pub struct PaperScene {
    /// The falling objects.
    pub scene: SceneName,
    /// Number of objects.
    pub n: usize,
    /// Figure 5, ms.
    pub update_ms: [f64; 4],
    /// Figure 7, ms.
    pub pairs_ms: [f64; 4],
}

impl PaperScene {
    /// Times of a stage, ms, by [`CORES`].
    pub const fn ms(&self, stage: Stage) -> [f64; 4] {
        match stage {
            Stage::UpdateAabbs => self.update_ms,
            Stage::OverlappingPairs => self.pairs_ms,
        }
    }
}

/// The scenes of Figure 4.
pub const SCENES: [PaperScene; 3] = [
    PaperScene {
        scene: SceneName::Cubes,
        n: 20_000,
        update_ms: [8.89, 4.96, 2.76, 1.52],
        pairs_ms: [53.339, 31.65, 18.76, 11.43],
    },
    PaperScene {
        scene: SceneName::Balls,
        n: 10_000,
        update_ms: [4.45, 2.48, 1.4, 0.74],
        pairs_ms: [26.7, 15.748, 9.51, 5.82],
    },
    PaperScene {
        scene: SceneName::Skittles,
        n: 3_500,
        update_ms: [1.6, 0.9, 0.5, 0.27],
        pairs_ms: [10.71, 6.35, 3.742, 2.314],
    },
];

/// The paper's time, ns, and speed-up over one core for a stage of a scene, at the paper's size.
pub fn figures(stage: Stage, scene: SceneName, threads: usize) -> Option<(u64, f64)> {
    let found = SCENES.iter().find(|paper| paper.scene == scene)?;
    let column = CORES.iter().position(|cores| *cores == threads)?;
    let ms = found.ms(stage);
    Some(((ms[column] * 1e6) as u64, ms[0] / ms[column]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_overall_speed_up_of_cubes_is_near_the_5_1_of_figure_9() {
        let sum = |column: usize| SCENES[0].update_ms[column] + SCENES[0].pairs_ms[column];
        let speed_up = sum(0) / sum(3);
        assert!((4.5..5.2).contains(&speed_up), "{speed_up}");
        let (ns, speed_up) =
            figures(Stage::UpdateAabbs, SceneName::Balls, 8).expect("the paper has it");
        assert_eq!(ns, 740_000);
        assert!((speed_up - 6.01).abs() < 0.01, "{speed_up}");
        assert_eq!(figures(Stage::UpdateAabbs, SceneName::Balls, 3), None);
        assert_eq!(figures(Stage::OverlappingPairs, SceneName::Uniform, 2), None);
    }
}
