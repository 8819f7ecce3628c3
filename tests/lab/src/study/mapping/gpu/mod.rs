//! The variants on a GPU: their answers, their errors, their times.

pub mod errors;
pub mod masks;
pub mod pairs;
pub mod times;

use bytemuck::Zeroable;
use pairmask_shaders::{ComposeError, ComposedStage};

use crate::study::mapping::stage::{IdWidth, MappingStage, Variant};
use crate::study::stage_bench::{StageBench, StudyStage};

/// Ids and numbers of a word.
pub(super) const WORD_IDS: u64 = 32;

/// A device and the stages of the study compiled on it.
pub type Bench = StageBench<MappingStage>;

impl StudyStage for MappingStage {
    fn label(self) -> &'static str {
        self.label()
    }

    fn composed(self) -> Result<ComposedStage, ComposeError> {
        self.composed()
    }
}

impl Bench {
    /// Whether the ids of a variant for `n` boxes fit this device's integers.
    pub fn fits(&self, variant: Variant, n: u32) -> bool {
        IdWidth::of(variant, n) == IdWidth::Bits32 || self.gpu().limits().int64
    }
}

fn zeroed<T: Zeroable + Clone>(count: usize) -> Vec<T> {
    vec![T::zeroed(); count]
}
