//! Structs that Rust and the study's stages share. A test compares each with naga's reflection.

use bytemuck::{Pod, Zeroable};

/// Parameters of the `mapping_pairs` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingPairsParams {
    /// Boxes.
    pub n: u32,
    /// Ids.
    pub id_count: u32,
}

/// Parameters of the `mapping_time` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingTimeParams {
    /// Boxes.
    pub n: u32,
    /// Words of 32 ids.
    pub word_count: u32,
    /// Workgroups of a dispatch row.
    pub groups_x: u32,
    /// A sum that no thread is expected to have.
    pub never: u32,
}

/// Parameters of the `mapping_errors` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingErrorsParams {
    /// Boxes.
    pub n: u32,
    /// Words of 32 ids.
    pub word_count: u32,
    /// Workgroups of a dispatch row.
    pub groups_x: u32,
    /// 1: a word around the start of each row, and not from `first` on.
    pub around_rows: u32,
    /// First id, low half.
    pub first_low: u32,
    /// First id, high half.
    pub first_high: u32,
    /// Ids from one word to the next, low half.
    pub stride_low: u32,
    /// Ids from one word to the next, high half.
    pub stride_high: u32,
    /// 1: pairs are marked.
    pub mark: u32,
}

/// Counts of the `mapping_errors` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingTally {
    /// Ids that were checked.
    pub ids: u32,
    /// Ids that the variant leaves out.
    pub skipped: u32,
    /// Ids mapped to another pair or to none.
    pub wrong: u32,
    /// Wrong ids that still name two different boxes.
    pub wrong_named: u32,
    /// Largest distance of a wrong id's row from its own.
    pub row_error: u32,
    /// Pairs named at least once, when marked.
    pub distinct: u32,
}

/// Parameters of the `mapping_root_errors` and `mapping_root_time` stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct RootParams {
    /// Numbers.
    pub count: u32,
    /// Words of 32 numbers.
    pub word_count: u32,
    /// Workgroups of a dispatch row.
    pub groups_x: u32,
    /// As in [`MappingTimeParams`].
    pub never: u32,
}

/// Counts of the `mapping_root_errors` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct RootTally {
    /// Integer parts other than the built-in root's.
    pub other: u32,
    /// Integer parts other than the exact one.
    pub inexact: u32,
}

/// Parameters of the `mapping_mask` and `mapping_mask_or` stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MaskParams {
    /// Boxes.
    pub n: u32,
    /// Pairs.
    pub pair_count: u32,
    /// Threads with work.
    pub thread_count: u32,
    /// Workgroups of a dispatch row.
    pub groups_x: u32,
}
