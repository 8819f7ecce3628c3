//! Replay: the requests of a recording, sent again one at a time, and their answers beside the recorded ones.
//!
//! ```text
//! player   the sessions of a recording, as sessions of a daemon or of this process
//! local    one that this process answers
//! tally    what was answered before and now, and what differs
//! ```

mod local;
mod player;
mod tally;

pub use player::{Answer, PlayError, Player};
pub use tally::{Difference, Kind, Latencies, Row, Tally};

use std::io::Read;
use std::time::{Duration, Instant};

use crate::recording::{Event, ReadError, Record, Recording};

/// How the requests follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// Each as soon as the last one is answered.
    Fast,
    /// None earlier than in the recording.
    Recorded,
}

#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error(transparent)]
    Play(#[from] PlayError),
}

/// Sends the requests of a recording to each player, and compares what they answer with the recording; of two players
/// also one with the other, entry by entry. Where the first one sends frames in another precision, these are compared
/// with the second one's alone, and may have more pairs. A recording that is cut or damaged is replayed up to there, and the tally
/// says so.
pub fn replay(
    recording: &mut Recording<impl Read>,
    players: &mut [Player],
    pace: Pace,
) -> Result<Tally, ReplayError> {
    let mut tally = Tally::new(players.len());
    let mut clock = Clock { pace, first: None };
    loop {
        let records = match recording.next_block() {
            Ok(Some(records)) => records,
            Ok(None) => break,
            Err(error @ (ReadError::Cut { .. } | ReadError::Damaged { .. })) => {
                tally.ends_early = Some(error.to_string());
                break;
            }
            Err(error) => return Err(error.into()),
        };
        records.iter().try_for_each(|record| step(record, players, &mut tally, &mut clock))?;
    }
    for (at, player) in players.iter_mut().enumerate() {
        player.end_all(|answer| tally.note_played(at, answer))?;
    }
    tally.end();
    Ok(tally)
}

fn step(
    record: &Record,
    players: &mut [Player],
    tally: &mut Tally,
    clock: &mut Clock,
) -> Result<(), PlayError> {
    match &record.event {
        Event::Request { session, number, header, payload } => {
            clock.wait(record.at_ns);
            tally.note_request(*number, Kind::of(header));
            for (at, player) in players.iter_mut().enumerate() {
                let request = (*session, *number, &**header, &payload[..]);
                player.send(request, |answer| tally.note_played(at, answer))?;
            }
        }
        Event::Answer { number, answered } => {
            tally.note_recorded(*number, *answered);
            // What was sent after it may not be part of the tick that it is of.
            for (at, player) in players.iter_mut().enumerate() {
                player.receive_number(*number, |answer| tally.note_played(at, answer))?;
            }
        }
        Event::SessionEnded { session, why } => {
            if why.is_early() {
                tally.cut_sessions += 1;
            }
            for (at, player) in players.iter_mut().enumerate() {
                player.end(*session, |answer| tally.note_played(at, answer))?;
            }
        }
        Event::WorkerBegan => {
            for (at, player) in players.iter_mut().enumerate() {
                player.end_all(|answer| tally.note_played(at, answer))?;
            }
            tally.end();
        }
    }
    Ok(())
}

struct Clock {
    pace: Pace,
    /// When the first request was sent, and when in the recording.
    first: Option<(Instant, u64)>,
}

impl Clock {
    fn wait(&mut self, at_ns: u64) {
        let now = Instant::now();
        let (begin, first_ns) = *self.first.get_or_insert((now, at_ns));
        if self.pace == Pace::Recorded {
            let due = Duration::from_nanos(at_ns.saturating_sub(first_ns));
            std::thread::sleep(due.saturating_sub(now - begin));
        }
    }
}
