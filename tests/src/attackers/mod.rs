//! Attacking processes: each attack is one file, run by the binary `attacker MODE` until its input
//! ends. An attacker writes to memory that it shares, and to the socket, what it likes.

mod daemon;
mod edits;
mod lengths;
pub mod lists;
mod queries;
pub mod raw;
mod ruin;
mod rules;
pub mod shared;
mod tokens;

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytemuck::cast_slice_mut;
use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::Report;
use pairmask_transport::{DaemonRecord, RuntimeDir};
use pairmask_wire::{
    EditLayout, InstanceName, Page, RequestHeader, ResponseHeader, SceneId, SceneRequest, Version,
};
use pairmaskd::scene::Random;

use self::raw::{RawClient, RawRequest, dice, write};

pub type Tally = BTreeMap<String, u64>;

#[derive(Clone, Debug)]
pub struct Until(Arc<AtomicBool>);

impl Until {
    fn input_ends() -> Self {
        let ended = Arc::new(AtomicBool::new(false));
        let report = Arc::clone(&ended);
        std::thread::spawn(move || {
            let _ = std::io::stdin().read_to_end(&mut Vec::new());
            report.store(true, Ordering::Relaxed);
        });
        Self(ended)
    }

    pub fn is_over(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

struct Forging {
    token: u64,
    /// Of a request.
    pages: usize,
    requests: u64,
    /// So many of four requests are forged.
    forged_of_four: u64,
    /// Words of the payload that are changed at most.
    payload_words: u64,
    /// One in so many is left unanswered; 0: none.
    given_up: u64,
}

impl Forging {
    const fn new(token: u64, pages: usize) -> Self {
        Self { token, pages, requests: 2_000, forged_of_four: 3, payload_words: 5, given_up: 0 }
    }

    /// Sends requests, client after client, until the attack is over: changes words of header and payload, and of the
    /// payload while the daemon reads it. `draw` writes a request by its number into the payload, or passes it over; it
    /// gets the client's last request and answer.
    fn attack(
        &self,
        until: &Until,
        tally: &mut Tally,
        mut draw: impl FnMut(
            &RawClient,
            &mut Random,
            &mut [Page],
            u64,
            Option<&(RequestHeader, ResponseHeader)>,
        ) -> Option<RequestHeader>,
    ) {
        let mut dice = dice();
        while let Some(client) = RawClient::reconnect(self.pages, until) {
            let mut last = None;
            for number in 0..self.requests {
                if until.is_over() {
                    return;
                }
                let Some(mut loan) = client.loan() else { break };
                let payload = loan.pages_mut();
                let drawn = draw(&client, &mut dice, payload, number, last.as_ref());
                let Some(mut header) = drawn else { continue };
                let is_forged = dice.below(4) < self.forged_of_four;
                if is_forged {
                    self.forge(&mut header, payload, &mut dice);
                }
                let (bytes, address) = (size_of_val(payload) as u64, payload.as_ptr() as usize);
                loan.header = header;
                let pending = client.send(loan);
                if self.given_up > 0 && dice.below(self.given_up) == 0 {
                    count(tally, "given up");
                    continue;
                }
                if is_forged && self.payload_words > 0 {
                    for _ in 0..dice.below(2_000) {
                        let value = dice.below(u64::MAX) >> dice.below(64);
                        write(address + 8 * dice.below(bytes / 8) as usize, value);
                    }
                }
                let Some(answered) = pending.answer(Duration::from_secs(2)) else {
                    count(tally, "unanswered");
                    break;
                };
                count(tally, if answered.status == 0 { "answered" } else { "refused" });
                last = Some((header, answered));
            }
        }
    }

    fn forge(&self, header: &mut RequestHeader, payload: &mut [Page], dice: &mut Random) {
        let some = |dice: &mut Random| (dice.below(u64::MAX) >> dice.below(64)) as u32;
        for _ in 0..dice.below(3) {
            let words: &mut [u32] = cast_slice_mut(bytemuck::bytes_of_mut(header));
            // Behind magic, version and operation, and the token.
            let slot = 8 + dice.below(words.len() as u64 - 8) as usize;
            words[slot] = some(dice);
        }
        let words: &mut [u32] = cast_slice_mut(payload);
        for _ in 0..dice.below(self.payload_words + 1) {
            // Most of what is read lies in the first pages.
            let slot = dice.below((words.len() as u64).min(4 * 1024)) as usize;
            words[slot] = some(dice);
        }
    }
}

/// A request of an edit that is laid out so, of flags by chance.
fn scene_request(
    dice: &mut Random,
    [scene, most_boxes]: [u32; 2],
    [base, revision]: [u64; 2],
    layout: &EditLayout,
) -> SceneRequest {
    let [boxes, steps, indices] = layout.sections();
    SceneRequest {
        scene: SceneId(scene),
        base,
        revision,
        is_acknowledged: dice.below(2) == 0,
        is_lost: dice.below(9) == 0,
        reported: (dice.below(9) == 0).then(|| dice.bits() >> dice.below(64)),
        report: [Report::Changes, Report::Moved, Report::All, Report::Nothing]
            [dice.below(4) as usize],
        most_boxes,
        engine: EngineChoice::Auto,
        threads: None,
        boxes,
        steps,
        indices,
    }
}

/// Does `work` while words alternate between two states, each written by a function, or stay as they are.
fn while_they_alternate<R>(
    goes_on: bool,
    states: [&(dyn Fn() + Sync); 2],
    work: impl FnOnce() -> R,
) -> R {
    let is_over = AtomicBool::new(!goes_on);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Relaxed) {
                for state in states {
                    state();
                }
            }
        });
        let done = work();
        is_over.store(true, Ordering::Relaxed);
        done
    })
}

/// Serves as a daemon whose answers have one page, until the attack is over: `answer` writes each and sends it.
fn serve(
    until: &Until,
    tally: &mut Tally,
    mut answer: impl FnMut(RawRequest),
) -> Result<(), Box<dyn Error>> {
    let (dir, name, pid) = (RuntimeDir::from_env(), InstanceName::default(), std::process::id());
    dir.ensure()?;
    let record =
        DaemonRecord { worker_pid: pid, supervisor_pid: pid, version: Version::CURRENT, fences: 0 };
    dir.write_record(&name, &record)?;
    let served = raw::serve(
        &dir,
        || until.is_over(),
        |request| {
            answer(request);
            count(tally, "rounds");
        },
    );
    dir.remove_record(&name);
    served.ok_or_else(|| "the socket cannot be served".into())
}

/// Attacks in a mode until the input ends, and prints the counts: `name=count` a line.
pub fn run(mode: &str) -> Result<(), Box<dyn Error>> {
    let until = Until::input_ends();
    let mut tally = Tally::new();
    match mode {
        "tokens" => tokens::attack(1, true, &until, &mut tally),
        "ports" => tokens::attack(8, false, &until, &mut tally),
        "lengths" => lengths::attack(&until, &mut tally),
        "scribble" => ruin::scribble(&until, &mut tally),
        "truncate" => ruin::truncate(&until, &mut tally),
        "daemon" => daemon::attack(&until, &mut tally)?,
        "edits" => edits::attack(&until, &mut tally),
        "rules" => rules::attack(&until, &mut tally),
        "queries" => queries::attack(&until, &mut tally),
        "shared" => shared::attack(&until, &mut tally),
        "lists" => lists::attack(&until, &mut tally)?,
        _ => return Err(format!("unknown attack '{mode}'").into()),
    }
    for (name, count) in tally {
        println!("{name}={count}");
    }
    Ok(())
}

fn count(tally: &mut Tally, name: &str) {
    *tally.entry(name.to_owned()).or_default() += 1;
}
