//! What a bridge says of a box: all that decides whether it is a pair with another one, and its user data.

use pairmask_core::aabb::{Aabb, BoxClass};
use pairmask_core::filters::{FilterData, Rules};

/// A box as its writer has set it. Two are equal where their bytes are.
#[derive(Clone, Copy, Debug)]
pub struct BoxState {
    /// The box, in its writer's bits.
    pub aabb: Aabb,
    /// Its filter data. Its filter is a place in the table that all machines are to give their scenes.
    pub filter_data: FilterData,
    /// Its user data.
    pub user_data: u64,
    /// Whether it is enabled.
    pub is_enabled: bool,
}

impl From<Aabb> for BoxState {
    fn from(aabb: Aabb) -> Self {
        Self { aabb, filter_data: FilterData::default(), user_data: 0, is_enabled: true }
    }
}

impl PartialEq for BoxState {
    fn eq(&self, other: &Self) -> bool {
        bytemuck::bytes_of(&self.aabb) == bytemuck::bytes_of(&other.aabb) && self.is_like(other)
    }
}

impl Eq for BoxState {}

impl BoxState {
    /// Whether all but the box is the same.
    pub fn is_like(&self, other: &Self) -> bool {
        self.filter_data == other.filter_data
            && self.user_data == other.user_data
            && self.is_enabled == other.is_enabled
    }

    /// Whether it may be a pair with anything.
    pub fn is_there(&self) -> bool {
        self.is_enabled && self.aabb.class() == BoxClass::Valid
    }

    /// Whether two boxes are a pair.
    pub fn meets(&self, other: &Self, rules: &Rules) -> bool {
        self.is_there()
            && other.is_there()
            && self.aabb.overlaps(&other.aabb)
            && rules.may_meet(&self.filter_data, &other.filter_data)
    }

    /// The lower corner of the intersection of two boxes that overlap, on an axis.
    pub fn corner_with(&self, other: &Self, axis: usize) -> f32 {
        self.aabb.min[axis].max(other.aabb.min[axis])
    }
}
