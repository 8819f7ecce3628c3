//! After how many frames that look alike a copy is made.

/// Most frames that have to look alike first. A copy takes about as long as a cull at worst, so that a
/// scene whose sample never moves loses a thousandth of its time.
const MOST: u32 = 1_024;

/// Counts frames that look like the one before, and learns from copies that were made in vain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patience {
    /// Frames in a row that looked like the one before.
    alike: u32,
    /// As many are asked for.
    wanted: u32,
}

impl Default for Patience {
    /// A copy is made of the first frame that looks like the one before.
    fn default() -> Self {
        Self { alike: 0, wanted: 1 }
    }
}

impl Patience {
    /// Notes a frame that looks like the one before. Whether a copy of it is to be made.
    pub(super) const fn note_alike(&mut self) -> bool {
        self.alike = self.alike.saturating_add(1);
        self.alike >= self.wanted
    }

    /// Notes a frame that looks different.
    pub(super) const fn note_moved(&mut self) {
        self.alike = 0;
    }

    /// Notes that a copy was given up: one that was never used asks for twice as many frames the next time,
    /// one that was for half.
    pub(super) const fn note_dropped(&mut self, was_used: bool) {
        self.alike = 0;
        self.wanted = if was_used { self.wanted / 2 } else { self.wanted * 2 };
        if self.wanted < 1 {
            self.wanted = 1;
        }
        if self.wanted > MOST {
            self.wanted = MOST;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Copies of so many frames that look alike and never are.
    fn copies_in_vain(frames: u32) -> u32 {
        let mut patience = Patience::default();
        let mut copies = 0;
        let mut has_copy = false;
        for _ in 0..frames {
            if std::mem::take(&mut has_copy) {
                patience.note_dropped(false);
            } else if patience.note_alike() {
                copies += 1;
                has_copy = true;
            }
        }
        copies
    }

    #[test]
    fn copies_in_vain_become_rare() {
        assert_eq!(copies_in_vain(1), 1);
        assert!(copies_in_vain(1_000) <= 10);
        let (before, after) = (copies_in_vain(100_000), copies_in_vain(200_000));
        assert!(after - before <= 100_000 / MOST + 1, "{before} {after}");
    }

    #[test]
    fn copies_that_are_used_are_made_at_once_again() {
        let mut patience = Patience::default();
        for _ in 0..20 {
            patience.note_dropped(false);
        }
        assert_eq!((0..MOST).filter(|_| patience.note_alike()).count(), 1, "after so many");
        patience.note_moved();
        assert!(!patience.note_alike(), "they have to come in a row");
        for _ in 0..10 {
            patience.note_dropped(true);
        }
        assert!(patience.note_alike());
    }
}
