//! The stages of the sweep.

use pairmask_shaders::{ComposeError, ComposedStage, compose, shared_part};

use crate::study::stage_bench::StudyStage;

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

    /// Storage buffers that the stage binds, numbered from 0.
    pub const fn binding_count(self) -> u32 {
        match self {
            Self::Keys | Self::Pairs => 5,
            Self::Count => 3,
            Self::Scan => 2,
            Self::Scatter => 6,
            Self::Gather => 4,
        }
    }

    const fn file(self) -> &'static str {
        match self {
            Self::Keys => include_str!("../../../shaders/sweep_keys.wgsl"),
            Self::Count => include_str!("../../../shaders/sweep_count.wgsl"),
            Self::Scan => include_str!("../../../shaders/sweep_scan.wgsl"),
            Self::Scatter => include_str!("../../../shaders/sweep_scatter.wgsl"),
            Self::Gather => include_str!("../../../shaders/sweep_gather.wgsl"),
            Self::Pairs => include_str!("../../../shaders/sweep_pairs.wgsl"),
        }
    }
}

impl StudyStage for SweepStage {
    fn label(self) -> &'static str {
        match self {
            Self::Keys => "sweep_keys",
            Self::Count => "sweep_count",
            Self::Scan => "sweep_scan",
            Self::Scatter => "sweep_scatter",
            Self::Gather => "sweep_gather",
            Self::Pairs => "sweep_pairs",
        }
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
        Ok(ComposedStage {
            label: self.label(),
            binding_count: self.binding_count(),
            wgsl: compose(self.file(), &part)?,
        })
    }
}
