//! Times of one stage of a scene by the number of threads.

use super::records::Figures;
use super::shapes::Threads;
use crate::study::threads::Stage;

/// The engine that compares all pairs, as the papers of 2009 and 2014 do.
pub const ALL_PAIRS: &str = "cpu-brute";

/// A stage of a scene of one size.
#[derive(Clone, Copy, Debug)]
pub struct Series {
    scene: &'static str,
    n: usize,
    /// `None` is the update of the boxes.
    engine: Option<&'static str>,
}

impl Series {
    /// World boxes from transforms.
    pub const fn update(scene: &'static str, n: usize) -> Self {
        Self { scene, n, engine: None }
    }

    /// Overlapping pairs by an engine.
    pub const fn pairs(scene: &'static str, n: usize, engine: &'static str) -> Self {
        Self { scene, n, engine: Some(engine) }
    }

    /// The least time on so many cores, ms; `None` where the machine has fewer cores: threads that
    /// take turns on one core say nothing of a core more.
    pub fn ms(self, threads: Option<&Threads>, cores: usize) -> Option<f64> {
        let threads = threads?;
        let stage = match self.engine {
            Some(_) => Stage::OverlappingPairs,
            None => Stage::UpdateAabbs,
        };
        let row = threads.rows.iter().find(|row| {
            row.stage == stage.as_str()
                && row.scene == self.scene
                && row.n == self.n
                && row.engine.as_deref() == self.engine
                && row.threads == cores
        })?;
        (cores <= threads.machine.threads).then_some(row.least_ns as f64 / 1e6)
    }

    /// One core's time over that of so many.
    pub fn speed_up(self, threads: Option<&Threads>, cores: usize) -> Option<f64> {
        Some(self.ms(threads, 1)? / self.ms(threads, cores)?)
    }
}

/// Why there is no figure on so many cores.
pub fn without_cores(figures: &Figures, series: Series, cores: usize) -> String {
    let measures = |threads: &Threads| series.ms(Some(threads), 1).is_some();
    let most = figures.threads.iter().filter(|source| measures(&source.data));
    let most = most.map(|source| source.data.machine.threads).max();
    let Series { scene, n, .. } = series;
    match most {
        Some(most) if most < cores => format!(
            "no machine of {cores} cores was measured with {n} boxes of {scene}: the largest has {most}"
        ),
        Some(_) => format!("`threads` has no row of {cores} threads for {n} boxes of {scene}"),
        None => format!("no record and no run has {n} boxes of {scene}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_beyond_the_cores_are_no_figure() {
        let json = r#"{"machine":{"cpu":"C","cores":2},"rows":[
            {"stage":"update-aabbs","scene":"cubes","n":9,"threads":1,"least_ns":4000000},
            {"stage":"update-aabbs","scene":"cubes","n":9,"threads":2,"least_ns":2000000},
            {"stage":"update-aabbs","scene":"cubes","n":9,"threads":8,"least_ns":1000000}]}"#;
        let threads: Threads = serde_json::from_str(json).expect("rows");
        let series = Series::update("cubes", 9);
        assert_eq!(series.speed_up(Some(&threads), 2), Some(2.0));
        assert_eq!(series.speed_up(Some(&threads), 8), None);
        assert_eq!(Series::update("balls", 9).ms(Some(&threads), 1), None);
        assert_eq!(Series::pairs("cubes", 9, ALL_PAIRS).ms(Some(&threads), 1), None);
        assert_eq!(series.ms(None, 1), None);
    }
}
