//! What was answered before and now, and what differs.

use std::collections::HashMap;
use std::fmt;

use pairmask_wire::{Operation, RequestHeader, StatusCode};
use serde::Serialize;

use super::player::Answer;
use crate::percentiles::Recorder;
use crate::recording::{Answered, Entry};

/// Differences that are described; all are counted.
const MOST_DESCRIBED: usize = 10;

/// What requests are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    Frame,
    Edit,
    Query,
    Cast,
    /// Begins and ends of scenes and leases.
    Other,
}

impl Kind {
    pub const ALL: [Self; 5] = [Self::Frame, Self::Edit, Self::Query, Self::Cast, Self::Other];

    pub const fn of(header: &RequestHeader) -> Self {
        const CULL: u32 = Operation::Cull as u32;
        const BETWEEN: u32 = Operation::CullBetween as u32;
        const EDIT: u32 = Operation::EditScene as u32;
        const COMMIT: u32 = Operation::CommitShared as u32;
        const QUERY: u32 = Operation::QueryScene as u32;
        const CAST: u32 = Operation::CastScene as u32;
        match header.operation {
            CULL | BETWEEN => Self::Frame,
            EDIT | COMMIT => Self::Edit,
            QUERY => Self::Query,
            CAST => Self::Cast,
            _ => Self::Other,
        }
    }

    pub const fn plural(self) -> &'static str {
        match self {
            Self::Frame => "frames",
            Self::Edit => "edits",
            Self::Query => "queries",
            Self::Cast => "casts",
            Self::Other => "others",
        }
    }
}

/// A request that is answered otherwise now.
#[derive(Clone, Debug, Serialize)]
pub struct Difference {
    pub request: u64,
    pub kind: Kind,
    pub text: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { request, kind, text } = self;
        let kind = kind.plural();
        write!(f, "request {request} (of {kind}): {text}")
    }
}

/// Times of the requests of a kind.
#[derive(Clone, Debug, Default)]
pub struct Latencies {
    /// In the daemon.
    pub daemon: Recorder,
    /// From the request to the answer.
    pub round_trip: Recorder,
}

/// The requests of a kind.
#[derive(Clone, Debug)]
pub struct Row {
    pub kind: Kind,
    pub requests: u64,
    /// Those whose answers differ.
    pub differing: u64,
    /// Those whose answer the recording does not have, and that are compared with nothing.
    pub uncompared: u64,
    /// Those that a player does not play.
    pub skipped: u64,
    /// Those that were sent in another precision.
    pub narrowed: u64,
    /// Pairs that the answers to these have more.
    pub extra_pairs: u64,
    /// Times in the daemon when it was recorded.
    pub recorded: Recorder,
    /// Of each player.
    pub played: Vec<Latencies>,
}

/// What is known of a request until all its answers are there.
struct Open {
    kind: Kind,
    recorded: Option<Answered>,
    played: Vec<Option<Answer>>,
}

pub struct Tally {
    players: usize,
    rows: Vec<Row>,
    open: HashMap<u64, Open>,
    /// The first ones.
    pub described: Vec<Difference>,
    /// Sessions that were recorded in part.
    pub cut_sessions: u64,
    /// Why the recording was read no further, where it was not read to its end.
    pub ends_early: Option<String>,
}

impl Tally {
    pub(super) fn new(players: usize) -> Self {
        let row = |kind| Row {
            kind,
            requests: 0,
            differing: 0,
            uncompared: 0,
            skipped: 0,
            narrowed: 0,
            extra_pairs: 0,
            recorded: Recorder::default(),
            played: vec![Latencies::default(); players],
        };
        Self {
            players,
            rows: Kind::ALL.map(row).into(),
            open: HashMap::new(),
            described: Vec::new(),
            cut_sessions: 0,
            ends_early: None,
        }
    }

    /// The kinds of requests that there were.
    pub fn rows(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| row.requests > 0)
    }

    pub fn requests(&self) -> u64 {
        self.rows.iter().map(|row| row.requests).sum()
    }

    pub fn differing(&self) -> u64 {
        self.rows.iter().map(|row| row.differing).sum()
    }

    pub fn uncompared(&self) -> u64 {
        self.rows.iter().map(|row| row.uncompared).sum()
    }

    /// Requests that a player did not play: those of shared scenes, in process.
    pub fn skipped(&self) -> u64 {
        self.rows.iter().map(|row| row.skipped).sum()
    }

    pub fn narrowed(&self) -> u64 {
        self.rows.iter().map(|row| row.narrowed).sum()
    }

    pub fn extra_pairs(&self) -> u64 {
        self.rows.iter().map(|row| row.extra_pairs).sum()
    }

    pub(super) fn note_request(&mut self, number: u64, kind: Kind) {
        let open = Open { kind, recorded: None, played: vec![None; self.players] };
        self.open.insert(number, open);
    }

    pub(super) fn note_recorded(&mut self, number: u64, answered: Answered) {
        if let Some(open) = self.open.get_mut(&number) {
            open.recorded = Some(answered);
        }
        self.close(number);
    }

    pub(super) fn note_played(&mut self, player: usize, answer: Answer) {
        let number = answer.number;
        if let Some(open) = self.open.get_mut(&number) {
            open.played[player] = Some(answer);
        }
        self.close(number);
    }

    /// Compares the answers of a request once all are there.
    fn close(&mut self, number: u64) {
        let is_whole =
            |open: &Open| open.recorded.is_some() && open.played.iter().all(Option::is_some);
        if self.open.get(&number).is_some_and(is_whole)
            && let Some(open) = self.open.remove(&number)
        {
            self.count(number, &open);
        }
    }

    /// No further answers come.
    pub(super) fn end(&mut self) {
        let mut open: Vec<(u64, Open)> = self.open.drain().collect();
        open.sort_unstable_by_key(|(number, _)| *number);
        for (number, open) in &open {
            self.count(*number, open);
        }
    }

    fn count(&mut self, number: u64, open: &Open) {
        let Open { kind, recorded, played } = open;
        let text = difference(recorded.as_ref(), played);
        let row = &mut self.rows[*kind as usize];
        row.requests += 1;
        row.differing += u64::from(text.is_some());
        let is_skipped = played.iter().any(Option::is_none);
        row.skipped += u64::from(is_skipped);
        row.uncompared += u64::from(recorded.is_none() && played.len() < 2 && !is_skipped);
        if let [Some(narrow), Some(exact)] = &played[..]
            && narrow.may_have_more
        {
            row.narrowed += 1;
            let counts = [narrow, exact].map(|answer| answer.answered.count);
            row.extra_pairs += counts[0].saturating_sub(counts[1]);
        }
        if let Some(recorded) = recorded {
            row.recorded.record(recorded.total_ns);
        }
        for (times, answer) in row.played.iter_mut().zip(played) {
            if let Some(answer) = answer {
                times.daemon.record(answer.answered.total_ns);
                times.round_trip.record(answer.round_trip.as_nanos() as u64);
            }
        }
        if let Some(text) = text.filter(|_| self.described.len() < MOST_DESCRIBED) {
            self.described.push(Difference { request: number, kind: *kind, text });
        }
    }
}

/// How the answers to a request differ, if they do.
fn difference(recorded: Option<&Answered>, played: &[Option<Answer>]) -> Option<String> {
    let now = played.first()?.as_ref()?;
    let other = played.get(1).and_then(Option::as_ref);
    // One that may have more pairs is compared with one that may not.
    let as_recorded = if now.may_have_more { other? } else { now };
    if let Some(recorded) = recorded.filter(|recorded| !recorded.agrees(&as_recorded.answered)) {
        return Some(of_digests(recorded, &as_recorded.answered));
    }
    let other = other?;
    match (&now.entries, &other.entries) {
        _ if now.answered.status != other.answered.status => {
            Some(of_digests(&now.answered, &other.answered))
        }
        (Some(narrow), Some(exact)) if now.may_have_more => of_missed(narrow, exact),
        (Some(one), Some(other)) => of_entries(one, other),
        _ => None,
    }
}

/// The first entry of the second of two sorted lists that the first one lacks.
fn of_missed(narrow: &[Entry], exact: &[Entry]) -> Option<String> {
    let is_missed = |entry: &&Entry| narrow.binary_search(entry).is_err();
    let [_, a, b, _] = exact.iter().find(is_missed)?;
    let missed = exact.iter().filter(is_missed).count();
    Some(format!("({a}, {b}) is missed, and {} others of {}", missed - 1, exact.len()))
}

fn of_digests(before: &Answered, now: &Answered) -> String {
    let status = |answered: &Answered| {
        let status = StatusCode::from_wire(answered.status);
        status.map_or_else(|| answered.status.to_string(), |status| status.as_str().to_owned())
    };
    if before.status != now.status {
        format!("'{}' before, '{}' now", status(before), status(now))
    } else if before.count != now.count {
        format!("{} pairs before, {} now", before.count, now.count)
    } else {
        format!("{} pairs, others than before", now.count)
    }
}

/// The first entry that one of two sorted lists has alone.
fn of_entries(one: &[Entry], other: &[Entry]) -> Option<String> {
    let longest = one.len().max(other.len());
    let at = (0..longest).find(|at| one.get(*at) != other.get(*at))?;
    let named = |entry: Option<&Entry>| match entry {
        Some([_, a, b, _]) => format!("({a}, {b})"),
        None => "nothing".to_owned(),
    };
    let (first, second) = (named(one.get(at)), named(other.get(at)));
    Some(format!("{first} and {second} at {at} of {} and {}", one.len(), other.len()))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn answer(status: u32, entries: &[Entry]) -> Answer {
        let digest = entries.iter().flatten().map(|number| u64::from(*number)).sum();
        let answered =
            Answered { status, count: entries.len() as u64, digest, ..Answered::default() };
        let (entries, round_trip) = (Some(entries.into()), Duration::ZERO);
        Answer { number: 1, answered, entries, round_trip, may_have_more: false }
    }

    #[test]
    fn a_difference_is_found_and_described() {
        let right = answer(0, &[[1, 2, 3, 0], [1, 4, 5, 0]]);
        let found = |recorded: &Answer, played: &[&Answer]| {
            let played: Vec<_> = played.iter().map(|answer| Some((*answer).clone())).collect();
            difference(Some(&recorded.answered), &played)
        };
        assert_eq!(found(&right, &[&right]), None);
        assert_eq!(found(&right, &[&right, &right]), None);
        let fewer = answer(0, &[[1, 2, 3, 0]]);
        let other = answer(0, &[[1, 2, 3, 0], [1, 4, 6, 0]]);
        let refused = answer(6, &[]);
        let text = |wrong: &Answer| found(&right, &[wrong]).expect("a difference");
        assert_eq!(text(&fewer), "2 pairs before, 1 now");
        assert_eq!(text(&other), "2 pairs, others than before");
        assert_eq!(text(&refused), "'ok' before, 'engine-unavailable' now");
        let beside = |wrong: &Answer| found(&right, &[&right, wrong]).expect("a difference");
        assert_eq!(beside(&fewer), "(4, 5) and nothing at 1 of 2 and 1");
        assert_eq!(beside(&other), "(4, 5) and (4, 6) at 1 of 2 and 2");
        assert!(beside(&refused).contains("engine-unavailable"));
    }
    #[test]
    fn a_frame_of_less_precision_may_have_more_pairs_and_misses_none() {
        let exact = answer(0, &[[1, 2, 3, 0], [1, 4, 5, 0]]);
        let near = |entries: &[Entry]| Answer { may_have_more: true, ..answer(0, entries) };
        let found = |recorded: &Answer, narrow: Answer, exact: &Answer| {
            difference(Some(&recorded.answered), &[Some(narrow), Some(exact.clone())])
        };
        let more = near(&[[1, 2, 3, 0], [1, 2, 9, 0], [1, 4, 5, 0]]);
        assert_eq!(found(&exact, more.clone(), &exact), None);
        // As many pairs as there are to be, and one of them another.
        let missed = near(&[[1, 2, 3, 0], [1, 2, 9, 0]]);
        let text = found(&exact, missed, &exact).expect("a difference");
        assert_eq!(text, "(4, 5) is missed, and 0 others of 2");
        let other = answer(0, &[[1, 2, 3, 0]]);
        let text = found(&other, more.clone(), &exact).expect("the exact one is not as recorded");
        assert_eq!(text, "1 pairs before, 2 now");

        let mut tally = Tally::new(2);
        tally.note_request(1, Kind::Frame);
        tally.note_recorded(1, exact.answered);
        tally.note_played(0, more);
        tally.note_played(1, exact);
        assert_eq!((tally.differing(), tally.narrowed(), tally.extra_pairs()), (0, 1, 1));
    }
}
