//! Rules that a daemon keeps for the frames to come: they are sent once.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use pairmask_core::filters::Rules;
use pairmask_core::units::BoxCount;

/// The rules that the daemon of a connection keeps, as far as this process knows.
#[derive(Debug, Default)]
pub struct CachedRules {
    kept: Mutex<Option<Cached>>,
    numbers: AtomicU64,
}

#[derive(Debug)]
struct Cached {
    /// Held, so that no others come to lie at its address.
    rules: Arc<Rules>,
    n: BoxCount,
    number: u64,
}

/// A number of rules. Never 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RulesNumber {
    /// Of those that the daemon keeps.
    Known(u64),
    /// Of those that the next frame brings, which the daemon keeps from then on.
    New(u64),
}

impl CachedRules {
    /// Whether the daemon keeps these rules of `n` boxes.
    pub fn are_known(&self, rules: &Arc<Rules>, n: BoxCount) -> bool {
        self.lock().as_ref().is_some_and(|kept| kept.is(rules, n))
    }

    /// The number of rules of `n` boxes. Those of a new number are to be sent.
    pub fn number_of(&self, rules: &Arc<Rules>, n: BoxCount) -> RulesNumber {
        let mut kept = self.lock();
        match &*kept {
            Some(kept) if kept.is(rules, n) => RulesNumber::Known(kept.number),
            _ => {
                let number = self.numbers.fetch_add(1, Ordering::Relaxed) + 1;
                *kept = Some(Cached { rules: Arc::clone(rules), n, number });
                RulesNumber::New(number)
            }
        }
    }

    /// Notes that the daemon keeps no rules, or others.
    pub fn discard(&self) {
        *self.lock() = None;
    }

    fn lock(&self) -> MutexGuard<'_, Option<Cached>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Cached {
    fn is(&self, rules: &Arc<Rules>, n: BoxCount) -> bool {
        Arc::ptr_eq(&self.rules, rules) && self.n == n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_rules_are_known_until_they_are_dropped() {
        let [a, b] = [(); 2].map(|()| Arc::new(Rules::default()));
        let [few, many] = [3, 9].map(BoxCount::new);
        let kept = CachedRules::default();
        assert_eq!(kept.number_of(&a, few), RulesNumber::New(1));
        assert_eq!(kept.number_of(&a, few), RulesNumber::Known(1));
        assert!(kept.are_known(&a, few) && !kept.are_known(&a, many) && !kept.are_known(&b, few));
        assert_eq!(kept.number_of(&a, many), RulesNumber::New(2), "filter data of more boxes");
        assert_eq!(kept.number_of(&b, many), RulesNumber::New(3), "equal, but not the same");
        assert_eq!(kept.number_of(&a, many), RulesNumber::New(4), "the last ones alone");
        kept.discard();
        assert_eq!(kept.number_of(&a, many), RulesNumber::New(5));
    }
}
