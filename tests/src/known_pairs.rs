//! What a client of a scene knows from the answers that it took.

use std::collections::BTreeSet;

use pairmask::SceneAnswer;
use pairmask_core::scene::Ended;

/// The pairs that a client knows from the answers that it took.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KnownPairs(BTreeSet<[u32; 2]>);

impl KnownPairs {
    /// Takes changes. A change that is told twice, or of a pair that is not known, is an error.
    ///
    /// # Errors
    /// What is wrong.
    pub fn change(
        &mut self,
        begun: impl IntoIterator<Item = [u32; 2]>,
        ended: impl IntoIterator<Item = Ended>,
    ) -> Result<(), String> {
        for ended in ended {
            if !self.0.remove(&ended.pair) {
                return Err(format!("{ended:?} ended and was not known"));
            }
        }
        for begun in begun {
            if !self.0.insert(begun) {
                return Err(format!("{begun:?} began and was known"));
            }
        }
        Ok(())
    }

    /// Takes an answer to changes.
    ///
    /// # Errors
    /// As [`Self::change`].
    pub fn tell(&mut self, answer: &SceneAnswer<'_>) -> Result<(), String> {
        if answer.is_resync() {
            self.resync(answer.pairs());
            return Ok(());
        }
        self.change(answer.begun(), answer.ended())
    }

    /// Takes all pairs in place of those that were known.
    pub fn resync(&mut self, pairs: impl IntoIterator<Item = [u32; 2]>) {
        self.0 = pairs.into_iter().collect();
    }

    /// The pairs, sorted.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 2]> {
        self.0.iter().copied()
    }

    /// Whether they are these, which are sorted.
    ///
    /// # Errors
    /// The first difference.
    pub fn compare(&self, pairs: &[[u32; 2]]) -> Result<(), String> {
        if self.0.iter().eq(pairs) {
            return Ok(());
        }
        let there: BTreeSet<_> = pairs.iter().copied().collect();
        let (missed, extra) = (there.difference(&self.0).next(), self.0.difference(&there).next());
        Err(format!("missed {missed:?}, extra {extra:?}, {} of {}", self.0.len(), there.len()))
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::scene::EndReason;

    use super::*;

    #[test]
    fn what_is_told_twice_or_never_is_noticed() {
        let mut known = KnownPairs::default();
        let ended = |pair| Ended { pair, reason: EndReason::Separated };
        known.change([[1, 2], [1, 3]], []).expect("new pairs");
        assert!(known.clone().change([[1, 2]], []).is_err());
        assert!(known.clone().change([], [ended([2, 3])]).is_err());
        known.change([[1, 2]], [ended([1, 2])]).expect("another box of the same index");
        known.compare(&[[1, 2], [1, 3]]).expect("both");
        assert!(known.compare(&[[1, 2]]).is_err() && known.compare(&[[1, 2], [2, 3]]).is_err());
        known.resync([[4, 5]]);
        known.compare(&[[4, 5]]).expect("what was told last");
    }
}
