//! What a client does next: a pure function of its seed and of what is under way.

use std::time::Duration;

use pairmaskd::scene::Random;

/// Longest pause: frames of a game at 60 Hz are this far apart.
const LONGEST_PAUSE_US: u64 = 17_000;

/// A step of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// A frame is sent by a session that has room for it.
    Send {
        /// The session.
        session: usize,
    },
    /// The answer to a frame under way is awaited and checked.
    Read {
        /// The session.
        session: usize,
        /// Which of its frames, the oldest is 0.
        frame: usize,
    },
    /// A frame under way is dropped, answered or not.
    Leave {
        /// The session.
        session: usize,
        /// Which of its frames.
        frame: usize,
    },
    /// Nothing for a while.
    Pause(Duration),
    /// Another scene takes the place of one.
    ChangeScene,
    /// A session is closed, and another one opened.
    Reconnect {
        /// The session.
        session: usize,
    },
}

/// The frames of a session.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    /// Under way.
    pub(super) under_way: usize,
    /// The most that may be.
    pub(super) most: usize,
}

/// Draws steps.
#[derive(Clone, Debug)]
pub(super) struct Steps {
    random: Random,
}

impl Steps {
    /// The steps of a client's seed.
    pub(super) const fn new(seed: u64) -> Self {
        Self { random: Random::new(seed) }
    }

    /// The next step. There is at least one session, each with room for at least one frame.
    pub(super) fn next(&mut self, sessions: &[Load]) -> Step {
        let session = self.below(sessions.len());
        let Load { under_way, most } = sessions[session];
        match self.random.below(200) {
            0..=5 => Step::Pause(Duration::from_micros(self.random.below(LONGEST_PAUSE_US))),
            6..=9 => Step::ChangeScene,
            10 => Step::Reconnect { session },
            11..=20 if under_way > 0 => Step::Leave { session, frame: self.below(under_way) },
            21..=110 if under_way < most => Step::Send { session },
            _ if under_way > 0 => Step::Read { session, frame: self.below(under_way) },
            _ => Step::Send { session },
        }
    }

    fn below(&mut self, bound: usize) -> usize {
        self.random.below(bound as u64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_send_only_with_room_and_read_only_what_is_under_way() {
        let mut steps = Steps::new(1);
        let mut loads = [1, 2, 3].map(|most| Load { under_way: 0, most });
        let mut counts = [0; 6];
        let mut fullest = 0;
        for _ in 0..20_000 {
            let step = steps.next(&loads);
            let kind = match step {
                Step::Send { session } => {
                    loads[session].under_way += 1;
                    0
                }
                Step::Read { session, frame } | Step::Leave { session, frame } => {
                    assert!(frame < loads[session].under_way);
                    loads[session].under_way -= 1;
                    if matches!(step, Step::Read { .. }) { 1 } else { 2 }
                }
                Step::Pause(_) => 3,
                Step::ChangeScene => 4,
                Step::Reconnect { session } => {
                    loads[session].under_way = 0;
                    5
                }
            };
            counts[kind] += 1;
            assert!(loads.iter().all(|load| load.under_way <= load.most));
            fullest += u32::from(loads[2].under_way == 3);
        }
        assert!(counts.iter().all(|count| *count > 20), "{counts:?}");
        assert!(counts[1] > 3 * counts[2], "most answers are read: {counts:?}");
        assert!(fullest > 500, "three frames at a time");
    }

    #[test]
    fn a_seed_gives_its_steps_again() {
        let loads = [Load { under_way: 1, most: 3 }; 2];
        let steps = |seed| {
            let mut steps = Steps::new(seed);
            (0..100).map(|_| steps.next(&loads)).collect::<Vec<_>>()
        };
        assert_eq!(steps(5), steps(5));
        assert_ne!(steps(5), steps(6));
    }
}
