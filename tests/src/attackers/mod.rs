//! Attacking processes: each attack is one file, run by the binary `attacker MODE` until its input
//! ends. An attacker writes to memory that it has mapped as a client, as any process of the same
//! user can.

mod daemon;
mod edits;
mod identities;
mod lengths;
pub mod lists;
mod once;
mod queries;
pub mod raw;
mod rules;
pub mod shared;
mod tokens;

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Read;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bytemuck::cast_slice_mut;
use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::Report;
use pairmask_transport::{Limits, ResponseLoan, RuntimeDir};
use pairmask_wire::{
    EditLayout, InstanceName, Page, RequestHeader, ResponseHeader, SceneId, SceneRequest, Version,
};
use pairmaskd::scene::Random;

use self::raw::{RawClient, answer, dice, write};
use crate::refuser;

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
        while let Some(client) = RawClient::reconnect(self.token, self.pages, until) {
            let mut last = None;
            for number in 0..self.requests {
                if until.is_over() {
                    return;
                }
                let Some(mut loan) = client.loan(self.pages) else { break };
                let payload = loan.payload_mut();
                let drawn = draw(&client, &mut dice, payload, number, last.as_ref());
                let Some(mut header) = drawn else { continue };
                let is_forged = dice.below(4) < self.forged_of_four;
                if is_forged {
                    self.forge(&mut header, payload, &mut dice);
                }
                let (bytes, address) = (size_of_val(payload) as u64, payload.as_ptr() as usize);
                *loan.user_header_mut() = header;
                let Some(pending) = client.send(loan) else { break };
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
                let Some(answered) = answer(&pending, Duration::from_secs(2)) else {
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
    mut answer: impl FnMut(&RequestHeader, ResponseLoan, &mut dyn FnMut(ResponseLoan) -> bool),
) -> Result<(), Box<dyn Error>> {
    let dir = RuntimeDir::from_env();
    let limits = Limits { max_reply_bytes: 4096, ..Limits::default() };
    dir.ensure()?;
    let is_over = || until.is_over();
    refuser::serve(Version::CURRENT, &dir, &limits, is_over, |asked, loan, send| {
        answer(asked, loan, &mut |loan| {
            let is_sent = send(loan);
            if is_sent {
                count(tally, "rounds");
            }
            is_sent
        });
    })?;
    dir.remove_record(&InstanceName::default());
    Ok(())
}

/// Attacks in a mode until the input ends, and prints the counts: `name=count` a line.
pub fn run(mode: &str) -> Result<(), Box<dyn Error>> {
    let until = Until::input_ends();
    let mut tally = Tally::new();
    match mode {
        "tokens" => tokens::attack(1, true, &until, &mut tally),
        "ports" => tokens::attack(8, false, &until, &mut tally),
        "lengths" => lengths::attack(&until, &mut tally),
        "channels" | "scribble" | "truncate" => repeat_in_children(mode, &until, &mut tally)?,
        "channels-once" => once::channels(&mut tally),
        "scribble-once" => once::scribble(&mut tally),
        "truncate-once" => once::truncate(&mut tally),
        "identities" => identities::attack(&until, &mut tally),
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

/// Runs each round in a child process, for attacks that break the attacker's own memory. The daemon
/// cleans up after the children.
fn repeat_in_children(mode: &str, until: &Until, tally: &mut Tally) -> Result<(), Box<dyn Error>> {
    let binary = std::env::current_exe()?;
    while !until.is_over() {
        let mut child = Command::new(&binary)
            .arg(format!("{mode}-once"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let started = Instant::now();
        while child.try_wait()?.is_none() {
            if started.elapsed() > CHILD_TIMEOUT {
                child.kill()?;
                count(tally, "killed");
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let mut said = String::new();
        if let Some(mut output) = child.stdout.take() {
            output.read_to_string(&mut said)?;
        }
        for (name, counted) in said.lines().filter_map(|line| line.split_once('=')) {
            *tally.entry(name.to_owned()).or_default() += counted.parse::<u64>()?;
        }
    }
    Ok(())
}

/// A child that runs longer hangs in memory that it broke itself; a round takes a tenth of this.
const CHILD_TIMEOUT: Duration = Duration::from_secs(2);

fn count(tally: &mut Tally, name: &str) {
    *tally.entry(name.to_owned()).or_default() += 1;
}
