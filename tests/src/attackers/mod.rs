//! Attacking processes: each attack is one file, run by the binary `attacker MODE` until its input
//! ends. An attacker writes to memory that it has mapped as a client, as any process of the same
//! user can.

mod channels;
mod daemon;
mod edits;
mod identities;
mod lengths;
pub mod lists;
mod queries;
pub mod raw;
mod rules;
mod scribble;
pub mod shared;
mod tokens;
mod truncate;

use std::collections::BTreeMap;
use std::error::Error;
use std::io::Read;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pairmask_transport::RequestLoan;
use pairmask_wire::ResponseHeader;

use self::raw::{Dice, RawClient, answer, write};

/// Counts of an attacker, by name.
pub type Tally = BTreeMap<String, u64>;

/// The end of an attack.
#[derive(Clone, Debug)]
pub struct Until(Arc<AtomicBool>);

impl Until {
    /// An attack until the standard input ends.
    fn input_ends() -> Self {
        let ended = Arc::new(AtomicBool::new(false));
        let tell = Arc::clone(&ended);
        std::thread::spawn(move || {
            let _ = std::io::stdin().read_to_end(&mut Vec::new());
            tell.store(true, Ordering::Relaxed);
        });
        Self(ended)
    }

    /// Whether the attack is over.
    pub fn is_over(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Sends a request, changes its payload while the daemon reads it if it is forged, and counts what becomes of it.
/// Returns the header of the answer; `None` where there is none, so that another client is needed.
fn send_and_spoil(
    client: &RawClient,
    mut loan: RequestLoan,
    is_forged: bool,
    dice: &mut Dice,
    tally: &mut Tally,
) -> Option<ResponseHeader> {
    let bytes = size_of_val(loan.payload_mut());
    let payload = loan.payload_mut().as_ptr() as usize;
    let pending = client.send(loan)?;
    if is_forged {
        for _ in 0..dice.below(2_000) {
            let place = 8 * dice.below(bytes as u64 / 8) as usize;
            write(payload + place, dice.below(u64::MAX) >> dice.below(64));
        }
    }
    let Some(answered) = answer(&pending, Duration::from_secs(2)) else {
        count(tally, "unanswered");
        return None;
    };
    count(tally, if answered.status == 0 { "answered" } else { "refused" });
    Some(answered)
}

/// Attacks in a mode until the input ends, and prints the counts: `name=count` a line.
///
/// # Errors
/// An unknown mode, or the end of an attack that cannot go on.
pub fn run(mode: &str) -> Result<(), Box<dyn Error>> {
    let until = Until::input_ends();
    let mut tally = Tally::new();
    match mode {
        "tokens" => tokens::attack(1, tokens::Tokens::Next, &until, &mut tally),
        "one-token" => tokens::attack(1, tokens::Tokens::Constant, &until, &mut tally),
        "ports" => tokens::attack(8, tokens::Tokens::Constant, &until, &mut tally),
        "lengths" => lengths::attack(&until, &mut tally),
        "channels" | "scribble" | "truncate" => repeat_in_children(mode, &until, &mut tally)?,
        "channels-once" => channels::attack(&mut tally),
        "scribble-once" => scribble::attack(&mut tally),
        "truncate-once" => truncate::attack(&mut tally),
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
            if started.elapsed() > CHILD_PATIENCE {
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
const CHILD_PATIENCE: Duration = Duration::from_secs(2);

/// Adds one to a count.
fn count(tally: &mut Tally, name: &str) {
    *tally.entry(name.to_owned()).or_default() += 1;
}
