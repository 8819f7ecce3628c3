//! The smallest script that still fails.

use std::collections::BTreeSet;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use super::check::{Failure, Seen, Subject, check};
use super::generate::{Kind, script_of};
use super::script::{Fate, Mode, Op, Script, Turn, at};
use pairmask_core::filters::{Filter, FilterData, Owner, World};

/// Scripts that are tried at most, and how long: a script of thousands of boxes is as small as it gets in that.
const MOST_TRIES: usize = 4_000;
const MOST_TIME: Duration = Duration::from_secs(60);

/// Plays scripts of so many edits in all, from a seed on, each on a scene of its own. Returns what was compared.
pub fn hold<S: Subject>(
    kind: Kind,
    seed: u64,
    edits: usize,
    subject: impl FnMut(&Script) -> S,
) -> Seen {
    hold_scripts(kind, |seed| script_of(kind, seed), seed, edits, subject)
}

pub fn hold_without_rules<S: Subject>(
    kind: Kind,
    seed: u64,
    edits: usize,
    subject: impl FnMut(&Script) -> S,
) -> Seen {
    hold_scripts(kind, |seed| script_of(kind, seed).without_rules(), seed, edits, subject)
}

/// With snapshots that are taken now and then, and gone back to.
pub fn script_with_snapshots(kind: Kind, seed: u64) -> Script {
    script_of(kind, seed).with_snapshots(seed)
}

/// Plays scripts of several kinds, and looks whether they had what there is to report.
pub fn hold_all<S: Subject>(
    script_of: impl Fn(Kind, u64) -> Script,
    seed: u64,
    kinds: [(Kind, usize); 3],
    mut subject: impl FnMut(&Script) -> S,
) -> Seen {
    let mut seen = Seen::default();
    for (kind, edits) in kinds {
        seen.add(hold_scripts(kind, |seed| script_of(kind, seed), seed, edits, &mut subject));
    }
    assert!(seen.ended.iter().all(|count| *count > 0), "each reason is reported: {seen:?}");
    assert!(seen.resyncs > 0, "{seen:?}");
    println!("{seen:?}");
    seen
}

pub fn hold_scripts<S: Subject>(
    kind: Kind,
    script_of: impl Fn(u64) -> Script,
    mut seed: u64,
    edits: usize,
    mut subject: impl FnMut(&Script) -> S,
) -> Seen {
    let mut seen = Seen::default();
    while seen.edits < edits {
        let script = script_of(seed);
        match play(&script, &mut subject) {
            Ok(more) => seen.add(more),
            Err(failure) => {
                let (small, failure) = shrunk(script, failure, &mut subject);
                panic!("seed {seed} of {kind:?}: {}\n{small}", failure.text);
            }
        }
        seed += 1;
    }
    seen
}

/// Plays a script; a panic is a failure too.
fn play<S: Subject>(
    script: &Script,
    subject: &mut impl FnMut(&Script) -> S,
) -> Result<Seen, Failure> {
    let played = catch_unwind(AssertUnwindSafe(|| check(script, &mut subject(script))));
    played.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).into()));
        Err(Failure { event: usize::MAX, kind: "panic", text: text.unwrap_or_default() })
    })
}

struct Shrinker<'s, F> {
    script: Script,
    failure: Failure,
    tries: usize,
    started: Instant,
    subject: &'s mut F,
}

/// The smallest script that fails in the same way, and how.
pub fn shrunk<S: Subject, F: FnMut(&Script) -> S>(
    script: Script,
    failure: Failure,
    subject: &mut F,
) -> (Script, Failure) {
    let mut shrinker = Shrinker { script, failure, tries: 0, started: Instant::now(), subject };
    loop {
        let before = shrinker.script.clone();
        shrinker.pass();
        if shrinker.script == before || shrinker.is_at_end() {
            return (shrinker.script, shrinker.failure);
        }
    }
}

impl<S: Subject, F: FnMut(&Script) -> S> Shrinker<'_, F> {
    fn is_at_end(&self) -> bool {
        self.tries >= MOST_TRIES || self.started.elapsed() > MOST_TIME
    }

    fn tries(&mut self, change: impl FnOnce(&mut Script)) -> bool {
        let mut smaller = self.script.clone();
        change(&mut smaller);
        smaller.repair();
        if smaller == self.script || self.is_at_end() {
            return false;
        }
        self.tries += 1;
        match play(&smaller, self.subject) {
            Err(failure) if failure.kind == self.failure.kind => {
                (self.script, self.failure) = (smaller, failure);
                true
            }
            _ => false,
        }
    }

    /// Takes as many as possible of what can be counted: halves, quarters, one by one.
    fn cut(&mut self, len: fn(&Script) -> usize, cut: fn(&mut Script, Range<usize>)) {
        let mut size = len(&self.script).div_ceil(2);
        while size > 0 {
            let mut end = len(&self.script);
            while end > 0 {
                let start = end.saturating_sub(size);
                self.tries(|script| cut(script, start..end));
                end = start.min(len(&self.script));
            }
            size /= 2;
        }
    }

    fn pass(&mut self) {
        let end = self.failure.event.saturating_add(1);
        self.tries(|script| script.events.truncate(end));
        self.cut(|script| script.events.len(), |script, out| drop(script.events.drain(out)));
        self.cut(
            |script| script.turns().count(),
            |script, out| {
                let mut stays = (0..).map(|number| !out.contains(&number));
                let turns = script.ticks_mut();
                turns.for_each(|turns| turns.retain(|_| stays.next() == Some(true)));
            },
        );
        self.cut(
            |script| script.turns().map(|turn| turn.ops.len()).sum(),
            |script, out| {
                let mut stays = (0..).map(|number| !out.contains(&number));
                let turns = script.ticks_mut().flatten();
                turns.for_each(|turn| turn.ops.retain(|_| stays.next() == Some(true)));
            },
        );
        let named = self.script.turns().flat_map(|turn| &turn.ops).flat_map(Op::indices);
        let indices: BTreeSet<u32> = named.copied().collect();
        for index in indices {
            self.tries(|script| {
                let turns = script.ticks_mut().flatten();
                turns.for_each(|turn| turn.ops.retain(|op| !op.indices().contains(&index)));
            });
        }
        self.simplify();
    }

    fn simplify(&mut self) {
        for number in 0..self.script.turns().count() {
            let plain: [fn(&mut Turn); 2] =
                [|turn| turn.mode = Mode::Changes, |turn| turn.fate = Fate::Acknowledged];
            for plain in plain {
                self.tries(|script| {
                    if let Some(turn) = script.ticks_mut().flatten().nth(number) {
                        plain(turn);
                    }
                });
            }
        }
        let count = self.script.turns().map(|turn| turn.ops.len()).sum::<usize>();
        for number in 0..count {
            for choice in 0..8 {
                let op = self.script.turns().flat_map(|turn| &turn.ops).nth(number);
                let Some(plain) = op.and_then(|op| plainer(op, choice)) else { break };
                let is_new = self.tries(|script| {
                    let ops = script.ticks_mut().flatten().flat_map(|turn| &mut turn.ops);
                    ops.skip(number).take(1).for_each(|op| *op = plain.clone());
                });
                if is_new && choice == 0 {
                    break;
                }
            }
        }
    }
}

/// An op in a plainer form, the plainest one first; `None` where there is no such choice.
fn plainer(op: &Op, choice: usize) -> Option<Op> {
    Some(match op {
        Op::Set(index, _) => {
            let x = [0.0, 10.0].get(choice)?;
            Op::Set(*index, at([*x, 0.0, 0.0, x + 1.0, 1.0, 1.0]))
        }
        Op::FilterData(index, filter_data) => Op::FilterData(
            *index,
            match choice {
                0 => FilterData::default(),
                1 => filter_data.with_static(false),
                2 => filter_data.with_world(World(0)),
                3 => filter_data.with_owner(Owner::NONE),
                4 => FilterData::new(
                    filter_data.world,
                    filter_data.owner,
                    pairmask_core::filters::FilterId(0),
                ),
                _ => return None,
            },
        ),
        Op::Filters(filters) if choice < 3 && !filters.is_empty() => {
            let mut filters = filters.clone();
            match choice {
                0 => filters.clear(),
                1 => drop(filters.pop()),
                _ => filters.fill(Filter::NONE),
            }
            Op::Filters(filters)
        }
        _ => return None,
    })
}
