//! When scratch memory is given back: what was large enough for a frame of the past and is much more
//! than the frames since have needed.

/// Frames by which the need is judged. Clients take turns, and a daemon has some dozens of them: a
/// client whose scene is large has had its turn by then.
const WINDOW_FRAMES: u32 = 64;

/// Scratch below this stays: to give it back would free nothing that a system notices.
const LEAST_BYTES: usize = 1 << 20;

/// Scratch up to so many times the need stays, so that scenes may come and go in size.
const SPARE: usize = 2;

/// The most that a frame has needed of late. It says when scratch memory that is kept from frame to
/// frame should be given back.
#[derive(Clone, Copy, Debug, Default)]
pub struct RecentNeed {
    frames: u32,
    most_bytes: usize,
}

impl RecentNeed {
    /// No frame yet.
    pub const NONE: Self = Self { frames: 0, most_bytes: 0 };

    /// Notes a frame's need, in bytes, 0 for a frame that was served otherwise. At the end of a
    /// window, `held_bytes` is asked for; `true` when that is so much more than any frame of the
    /// window needed that it is to be given back.
    #[inline]
    pub fn note(&mut self, needed_bytes: usize, held_bytes: impl FnOnce() -> usize) -> bool {
        self.frames += 1;
        self.most_bytes = self.most_bytes.max(needed_bytes);
        if self.frames < WINDOW_FRAMES {
            return false;
        }
        let Self { most_bytes, .. } = std::mem::take(self);
        held_bytes() > most_bytes.saturating_mul(SPARE).max(LEAST_BYTES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether so much is given back at the end of a window of frames with such a need.
    fn given_back(held: usize, needs: impl Iterator<Item = usize>) -> bool {
        let mut recent = RecentNeed::default();
        let noted: Vec<bool> = needs.map(|need| recent.note(need, || held)).collect();
        assert_eq!(noted.len(), WINDOW_FRAMES as usize);
        assert!(!noted[..noted.len() - 1].contains(&true), "not within the window");
        noted[noted.len() - 1]
    }

    #[test]
    fn memory_that_no_frame_of_a_window_needed_is_given_back() {
        let mib = 1 << 20;
        let all = |need: usize| std::iter::repeat_n(need, WINDOW_FRAMES as usize);
        assert!(given_back(100 * mib, all(mib)));
        assert!(given_back(2 * mib, all(0)));
        assert!(!given_back(mib, all(0)), "too little to bother");
        assert!(!given_back(100 * mib, all(50 * mib)));
        let one_large = (0..WINDOW_FRAMES).map(|i| if i == 7 { 50 * mib } else { 0 });
        assert!(!given_back(100 * mib, one_large), "one client of many has a large scene");
    }
}
