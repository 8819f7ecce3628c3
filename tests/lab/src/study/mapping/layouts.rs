//! Structs that Rust and the study's stages share. A test compares each with naga's reflection.
#![allow(missing_docs)] // The structs of the same names in the WGSL say what their fields are.

use bytemuck::{Pod, Zeroable};

/// Parameters of the `mapping_pairs` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingPairsParams {
    pub n: u32,
    pub id_count: u32,
}

/// Parameters of the `mapping_time` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingTimeParams {
    pub n: u32,
    pub word_count: u32,
    pub groups_x: u32,
    pub never: u32,
}

/// Parameters of the `mapping_errors` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingErrorsParams {
    pub n: u32,
    pub word_count: u32,
    pub groups_x: u32,
    pub around_rows: u32,
    pub first_low: u32,
    pub first_high: u32,
    pub stride_low: u32,
    pub stride_high: u32,
    pub mark: u32,
}

/// Counts of the `mapping_errors` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MappingTally {
    pub ids: u32,
    pub skipped: u32,
    pub wrong: u32,
    pub wrong_named: u32,
    pub row_error: u32,
    pub distinct: u32,
}

/// Parameters of the `mapping_root_errors` and `mapping_root_time` stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct RootParams {
    pub count: u32,
    pub word_count: u32,
    pub groups_x: u32,
    pub never: u32,
}

/// Counts of the `mapping_root_errors` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct RootTally {
    pub other: u32,
    pub inexact: u32,
}

/// Parameters of the `mapping_mask` and `mapping_mask_or` stages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct MaskParams {
    pub n: u32,
    pub pair_count: u32,
    pub thread_count: u32,
    pub groups_x: u32,
}
