//! The stages of the sweep.

use pairmask_shaders::{ComposeError, ComposedStage, compose, shared_part};

use crate::study::harness::stage_bench::StudyStage;

/// A stage of the sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SweepStage {
    /// Boxes to records and entries.
    Keys,
    /// Entries of a tile by digit.
    Count,
    /// Where the entries of a tile and digit go.
    Scan,
    /// Entries to there.
    Scatter,
    /// Records in the order of the entries.
    Gather,
    /// Pairs.
    Pairs,
}

impl SweepStage {
    /// All of them, in order.
    pub const ALL: [Self; 6] =
        [Self::Keys, Self::Count, Self::Scan, Self::Scatter, Self::Gather, Self::Pairs];

    /// Name, file, and storage buffers, numbered from 0.
    const fn parts(self) -> (&'static str, &'static str, u32) {
        macro_rules! stage {
            ($name:literal, $bindings:literal) => {
                ($name, include_str!(concat!("../../../shaders/", $name, ".wgsl")), $bindings)
            };
        }
        match self {
            Self::Keys => stage!("sweep_keys", 5),
            Self::Count => stage!("sweep_count", 3),
            Self::Scan => stage!("sweep_scan", 2),
            Self::Scatter => stage!("sweep_scatter", 6),
            Self::Gather => stage!("sweep_gather", 4),
            Self::Pairs => stage!("sweep_pairs", 5),
        }
    }
}

impl StudyStage for SweepStage {
    fn label(self) -> &'static str {
        self.parts().0
    }

    fn composed(self) -> Result<ComposedStage, ComposeError> {
        let own = |name: &str| match name {
            "sweep_params" => Some(include_str!("../../../shaders/shared/sweep_params.wgsl")),
            "sweep_digits" => Some(include_str!("../../../shaders/shared/sweep_digits.wgsl")),
            _ => None,
        };
        let part = |name: &str| {
            own(name).map(str::to_owned).or_else(|| shared_part(name)).ok_or_else(|| {
                ComposeError::UnknownImport { stage: self.label(), import: name.to_owned() }
            })
        };
        let (label, file, binding_count) = self.parts();
        Ok(ComposedStage { label, binding_count, wgsl: compose(file, &part)? })
    }
}
