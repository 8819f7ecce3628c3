use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterData, FilterId, Owner, World};

use super::*;
use crate::state::BoxState;

/// xorshift64*.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, n: u64) -> u64 {
        (self.next() >> 11) % n
    }

    /// Any bits: NaNs, infinities and subnormals among them.
    fn aabb(&mut self) -> Aabb {
        let mut x = || f32::from_bits(self.next() as u32);
        Aabb { min: [x(), x(), x()], max: [x(), x(), x()] }
    }

    fn state(&mut self) -> BoxState {
        let mut state = BoxState::from(self.aabb());
        state.is_enabled = self.below(4) > 0;
        if self.below(2) == 0 {
            let world = World(self.next() as i32);
            let filter_data = FilterData::new(world, Owner(self.next() as u32), FilterId(9));
            state.filter_data = filter_data.with_static(self.below(2) == 0);
            state.user_data = self.next();
            let filter = Filter::new(self.next(), self.next()).with_group(self.next() as i32);
            state.filter = filter.with_static(self.below(2) == 0).with_either(self.below(2) == 0);
        }
        state
    }

    fn indices(&mut self) -> Vec<u32> {
        let mut indices: Vec<u32> = (0..self.below(20)).map(|_| self.next() as u32).collect();
        indices.extend([u32::MAX, 0].iter().take(self.below(3) as usize));
        indices.sort_unstable();
        indices.dedup();
        indices
    }

    fn message(&mut self) -> Message {
        let version = Version { counter: self.below(1 << 40), steward: MachineId(7) };
        match self.below(3) {
            0 => {
                let corners = (0..self.below(40)).map(|_| self.below(1_000) as f32 - 500.0);
                let spread = Spread::of(corners.collect());
                let terms = Terms { axis: 2, lease_ms: 1_000 };
                let suspects = self.indices().into_iter().map(MachineId).collect();
                let (tick, counter) = (self.next(), self.next());
                Message::Beat(Beat { terms, tick, is_settled: true, counter, suspects, spread })
            }
            1 => {
                let count = 1 + self.below(9) as u32;
                let peer = |k| Peer { machine: MachineId(k * 3), incarnation: u64::from(k) << 50 };
                let members: Vec<Peer> = (0..count).map(peer).collect();
                let cuts = (1..count).map(|k| k as f32 * 0.5 - 1.0).collect();
                let owners = (0..count as u16).rev().collect();
                let space = Space { axis: 0, cuts, owners };
                let view = View { version, members, space };
                let (base, base_start) = (version, self.next());
                Message::Propose(Proposal { view, base, base_start })
            }
            _ => {
                let mut edits = Edits { removed: self.indices(), ..Edits::default() };
                for index in self.indices() {
                    let (incarnation, state) = (self.next() as u32, self.state());
                    let before = (self.below(2) == 0).then(|| self.state());
                    edits.entered.push(Entered { index, incarnation, state, before });
                }
                for index in self.indices() {
                    edits.moved.push((index, self.aabb()));
                    edits.left.push((index, self.state()));
                }
                let tick = self.below(1 << 47);
                let since = tick.saturating_sub(self.below(1 << 40));
                let to = Peer { machine: MachineId(3), incarnation: self.next() };
                let (prior, start, hold) = (version, self.next(), self.next());
                let [acknowledged, seen] = [self.next(), self.next()];
                Message::Batch(Batch {
                    to,
                    version,
                    prior,
                    start,
                    hold,
                    acknowledged,
                    seen,
                    since,
                    tick,
                    edits,
                })
            }
        }
    }
}

const HEAD: Head =
    Head { scene: 0x0123_4567_89ab_cdef, from: Peer { machine: MachineId(5), incarnation: 99 } };

/// As bytes: messages with NaNs are not equal to themselves.
fn again(message: &Message) -> Vec<u8> {
    let (head, read) = Head::read(&HEAD.message(message)).expect("what was written");
    assert_eq!(head, HEAD);
    HEAD.message(&read)
}

#[test]
fn messages_come_back_byte_by_byte() {
    let mut random = Random(3);
    for _ in 0..2_000 {
        let message = random.message();
        assert_eq!(again(&message), HEAD.message(&message), "{message:?}");
    }
    let batch = |index| {
        let edits = Edits { removed: vec![index], ..Edits::default() };
        edits.to_bytes()
    };
    assert_ne!(batch(4), batch(5), "what differs is written");
}

#[test]
fn truncated_messages_and_longer_ones_are_refused() {
    let mut random = Random(4);
    for _ in 0..200 {
        let bytes = HEAD.message(&random.message());
        for end in 0..bytes.len() {
            assert!(Head::read(&bytes[..end]).is_err(), "{end} of {}", bytes.len());
        }
        let longer = [&bytes[..], &[0]].concat();
        assert!(Head::read(&longer).is_err());
    }
}

#[test]
fn any_bytes_are_refused_or_read_as_what_they_say() {
    let mut random = Random(5);
    let (mut refused, mut read) = (0, 0);
    for _ in 0..100_000 {
        let mut bytes = HEAD.message(&random.message());
        for _ in 0..=random.below(3) {
            let at = random.below(bytes.len() as u64) as usize;
            bytes[at] = random.next() as u8;
        }
        match Head::read(&bytes) {
            // What is read is written, and read, alike.
            Ok((head, message)) => {
                let written = head.message(&message);
                let (_, again) = Head::read(&written).expect("what was written");
                assert_eq!(head.message(&again), written);
                read += 1;
            }
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 1_000 && read > 1_000, "{refused} {read}");
}

#[test]
fn refusals_have_names() {
    let message = Message::Beat(Beat {
        terms: Terms { axis: 0, lease_ms: 1 },
        tick: 1,
        is_settled: false,
        counter: 1,
        suspects: Vec::new(),
        spread: Spread::default(),
    });
    let bytes = HEAD.message(&message);
    let with = |at: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = value;
        Head::read(&bytes).map(|_| ())
    };
    assert_eq!(with(0, b'X'), Err(Refused::Magic(u32::from_le_bytes(*b"XMBR"))));
    let newer = PROTOCOL_VERSION + 1;
    assert_eq!(with(4, newer as u8), Err(Refused::Version(newer)));
    assert_eq!(with(6, 9), Err(Refused::Kind(9)));
    assert_eq!(with(HEAD_BYTES, 3), Err(Refused::Field("axis")));
    assert_eq!(with(0, b'P'), Ok(()));
    let long = vec![0; MOST_MESSAGE_BYTES + 1];
    assert_eq!(Head::read(&long).map(|_| ()), Err(Refused::TooLong(long.len())));
}
