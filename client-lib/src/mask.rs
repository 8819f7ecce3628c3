//! Masks, to be decoded in other ways than by the shortcuts of [`PairMask`](crate::PairMask).

pub use pairmask_core::awake_pool::AwakePool;
pub use pairmask_core::mask::{
    AddressedWord, DenseMask, ListMask, MaskShape, MaskView, Pairs, ParPairs, SparseMask,
    WordAddress, Words,
};
pub use pairmask_core::units::{MaskWord, PairIndex};
