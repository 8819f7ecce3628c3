//! Births and deaths of the clients of a soak: each lives for a drawn time, then is killed or asked to end, and
//! another one is started in its stead.

use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::time::{Duration, Instant};

use pairmaskd::scene::Random;

use crate::stress::clients::{Crowd, ENDS_WITHIN};

/// Lives of clients, s, log-uniform: as many live for seconds as for minutes.
const LIFE_S: Range<f32> = 2.0..180.0;
/// One client in so many is killed, the others are asked to end.
const KILLED_ONE_IN: u64 = 3;

#[derive(Clone, Copy, Debug)]
enum Life {
    Until {
        end: Instant,
        is_killed: bool,
    },
    /// It was asked to end, and has to by then.
    Leaving(Instant),
}

#[derive(Debug)]
pub(crate) struct Turnover {
    clients: usize,
    random: Random,
    lives: BTreeMap<u64, Life>,
    asked: u64,
}

impl Turnover {
    pub(crate) fn new(clients: usize, seed: u64) -> Self {
        Self { clients, random: Random::new(!seed), lives: BTreeMap::new(), asked: 0 }
    }

    /// Clients that were asked to end so far.
    pub(crate) const fn asked_to_end(&self) -> u64 {
        self.asked
    }

    pub(crate) fn turn(&mut self, crowd: &mut Crowd<'_>) -> io::Result<()> {
        let now = Instant::now();
        let numbers = crowd.numbers();
        self.lives.retain(|number, _| numbers.binary_search(number).is_ok());
        for number in numbers {
            let random = &mut self.random;
            let life = self.lives.entry(number).or_insert_with(|| Life::draw(now, random));
            match *life {
                Life::Until { end, is_killed: true } if now >= end => crowd.kill(number),
                Life::Until { end, .. } if now >= end => {
                    crowd.end(number);
                    self.asked += 1;
                    *life = Life::Leaving(now + ENDS_WITHIN);
                }
                Life::Leaving(deadline) if now >= deadline => crowd.give_up(number),
                _ => {}
            }
        }
        let is_leaving = |number| matches!(self.lives.get(number), Some(Life::Leaving(_)));
        let staying = crowd.numbers().iter().filter(|number| !is_leaving(number)).count();
        (staying..self.clients).try_for_each(|_| crowd.start())
    }
}

impl Life {
    fn draw(now: Instant, random: &mut Random) -> Self {
        let life = Duration::from_secs_f32(random.log_range(LIFE_S.start, LIFE_S.end));
        Self::Until { end: now + life, is_killed: random.below(KILLED_ONE_IN) == 0 }
    }
}
