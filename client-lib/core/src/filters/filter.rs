//! A filter: what boxes of a kind meet.

/// What boxes of a kind meet.
///
/// ```
/// use pairmask_core::filters::Filter;
///
/// let player = Filter::new(0b01, 0b10);
/// let enemy = Filter::new(0b10, 0b11);
/// assert!(player.admits(&enemy));
/// assert!(enemy.admits(&enemy));
/// assert!(!player.admits(&player), "no player is in a player's mask");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Filter {
    /// Boxes of this kind are static: two static boxes never meet.
    pub is_static: bool,
    /// Equal groups other than 0 decide by their sign: positive, they meet; negative, they do not.
    pub group: i32,
    /// What it is: a bit a category.
    pub category: u64,
    /// What it meets: a bit a category.
    pub mask: u64,
    /// Where both filters say so, it is enough that one has the other in its mask.
    pub either: bool,
}

impl Default for Filter {
    fn default() -> Self {
        Self::ALL
    }
}

impl Filter {
    /// Meets everything: of all categories, with all in its mask.
    pub const ALL: Self = Self::new(u64::MAX, u64::MAX);
    /// Meets nothing.
    pub const NONE: Self = Self::new(0, 0);

    /// A filter of some categories that has some in its mask.
    pub const fn new(category: u64, mask: u64) -> Self {
        Self { is_static: false, group: 0, category, mask, either: false }
    }

    /// The same for static boxes.
    #[must_use]
    pub const fn with_static(self, is_static: bool) -> Self {
        Self { is_static, ..self }
    }

    /// The same in a group.
    #[must_use]
    pub const fn with_group(self, group: i32) -> Self {
        Self { group, ..self }
    }

    /// The same, for which one mask of two is enough.
    #[must_use]
    pub const fn with_either(self, either: bool) -> Self {
        Self { either, ..self }
    }

    /// Whether boxes of the two kinds meet, as far as these say: rules 6 and 7 of the
    /// [order](crate::filters).
    #[inline]
    pub const fn admits(&self, other: &Self) -> bool {
        if self.group == other.group && self.group != 0 {
            return self.group > 0;
        }
        let (a, b) = (self.category & other.mask != 0, other.category & self.mask != 0);
        if self.either && other.either { a || b } else { a && b }
    }
}
