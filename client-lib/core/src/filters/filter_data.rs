//! What a box is to the rules.

use bytemuck::{Pod, Zeroable};

/// The world of a box. Boxes of different worlds never meet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct World(pub i32);

impl World {
    /// All worlds at once: ground that simulations side by side share.
    pub const ALL: Self = Self(-1);

    /// Whether boxes of two worlds may meet.
    #[inline]
    pub const fn meets(self, other: Self) -> bool {
        self.0 == other.0 || self.0 == Self::ALL.0 || other.0 == Self::ALL.0
    }
}

/// Who owns a box: boxes of one owner never meet, such as the parts of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct Owner(pub u32);

impl Owner {
    /// Nobody: such boxes meet one another.
    pub const NONE: Self = Self(0);
}

/// A place in a [`FilterTable`](super::FilterTable).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct FilterId(pub u16);

/// What a box is to the rules: 12 bytes. The default, world 0, no owner and the table's first filter, is
/// what a box has that was given none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Pod, Zeroable)]
#[repr(C)]
pub struct FilterData {
    /// Its world.
    pub world: World,
    /// Its owner.
    pub owner: Owner,
    /// Its filter.
    pub filter: FilterId,
    flags: u16,
}

/// Flag of filter data: the box itself is static, regardless of its filter.
const STATIC: u16 = 1;

impl FilterData {
    /// The filter data of a world, an owner and a filter.
    pub const fn new(world: World, owner: Owner, filter: FilterId) -> Self {
        Self { world, owner, filter, flags: 0 }
    }

    /// The same in another world.
    #[must_use]
    pub const fn with_world(self, world: World) -> Self {
        Self { world, ..self }
    }

    /// The same of another owner.
    #[must_use]
    pub const fn with_owner(self, owner: Owner) -> Self {
        Self { owner, ..self }
    }

    /// The same with another filter.
    #[must_use]
    pub const fn with_filter(self, filter: FilterId) -> Self {
        Self { filter, ..self }
    }

    /// The same for a box that is static, or is not, regardless of what its filter says. In a scene an edit's steps say
    /// which boxes are static, and not their filter data.
    #[must_use]
    pub const fn with_static(self, is_static: bool) -> Self {
        Self { flags: if is_static { STATIC } else { 0 }, ..self }
    }

    /// Whether the box itself is static.
    #[inline]
    pub const fn is_static(self) -> bool {
        self.flags & STATIC != 0
    }
}
