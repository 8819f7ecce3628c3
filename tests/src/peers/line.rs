//! Measurements of one scene and size, and the rows that compare them.

use std::fmt;

use clap::ValueEnum;
use pairmaskd::scene::SceneName;

use crate::measure::percentile;

/// A library, and one way of its users to keep it up to date.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PeerName {
    /// parry3d's tree, refitted each frame
    ParryRefit,
    /// parry3d's tree, a few subtrees built anew each frame, then refitted
    ParryOptimize,
    /// rapier3d's broad phase
    Rapier,
}

impl fmt::Display for PeerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.to_possible_value().map_or(Ok(()), |value| f.pad(value.get_name()))
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spread {
    pub p10_ns: u64,
    pub median_ns: u64,
    pub p90_ns: u64,
}

impl Spread {
    pub fn of(times_ns: &[u64]) -> Self {
        let [p10_ns, median_ns, p90_ns] = [0.1, 0.5, 0.9].map(|share| percentile(times_ns, share));
        Self { p10_ns, median_ns, p90_ns }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Who {
    Ours {
        /// `daemon` or `in-process`.
        backend: &'static str,
        /// The engine that answered, behind `auto:` where the plan chose it.
        engine: String,
    },
    Peer(PeerName),
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    pub who: Who,
    pub threads: usize,
    /// Time of a whole frame, from the user's boxes to all pairs iterated over; all frames.
    pub frame: Spread,
    pub late: Spread,
    /// The part of `frame` that writes the boxes where they can be read; 0 for peers, whose update
    /// reads the user's boxes.
    pub write: Spread,
    /// Whether the contender was so slow that it was left out of most frames.
    pub is_given_up: bool,
    pub fault: Option<String>,
}

impl Line {
    /// The best is the fastest that found every pair.
    const fn rank(&self) -> (bool, u64) {
        (self.fault.is_some(), self.frame.median_ns)
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Comparison {
    pub scene: SceneName,
    pub n: usize,
    pub pairs: u64,
    pub lines: Vec<Line>,
}

#[derive(Clone, Debug)]
pub struct PeerRow<'c> {
    pub of: &'c Comparison,
    /// `daemon` or `in-process`.
    pub backend: &'static str,
    pub engine: &'c str,
    /// Ours. A peer that is faster on fewer threads counts with that time.
    pub ours: &'c Line,
    pub peer: PeerName,
    /// The peer's, with its best number of threads up to ours.
    pub theirs: &'c Line,
    /// Whether no other peer that returns every pair is faster.
    pub is_best_peer: bool,
}

impl PeerRow<'_> {
    /// Ours over theirs, medians; of all frames, and of the last tenth.
    pub fn ratios(&self) -> [f64; 2] {
        let of = [(self.ours.frame, self.theirs.frame), (self.ours.late, self.theirs.late)];
        of.map(|(ours, theirs)| ours.median_ns as f64 / theirs.median_ns.max(1) as f64)
    }

    /// Whether both had the pairs of the reference on every frame that was compared.
    pub const fn are_pairs_equal(&self) -> bool {
        self.ours.fault.is_none() && self.theirs.fault.is_none()
    }
}

impl Comparison {
    pub fn rows(&self) -> Vec<PeerRow<'_>> {
        let mut rows = Vec::new();
        for ours in &self.lines {
            let Who::Ours { backend, engine } = &ours.who else { continue };
            let mut peers = self.best_of_each_peer(ours.threads);
            peers.sort_by_key(|(_, line)| line.rank());
            for (slot, (peer, theirs)) in peers.into_iter().enumerate() {
                let is_best_peer = slot == 0 && theirs.fault.is_none();
                rows.push(PeerRow { of: self, backend, engine, ours, peer, theirs, is_best_peer });
            }
        }
        rows
    }

    pub fn is_wrong(&self) -> bool {
        self.lines.iter().any(|l| matches!(l.who, Who::Ours { .. }) && l.fault.is_some())
    }

    /// Each peer with the number of threads up to `threads` that serves it best.
    fn best_of_each_peer(&self, threads: usize) -> Vec<(PeerName, &Line)> {
        let best = |&name: &PeerName| {
            let is_it = |line: &&Line| line.who == Who::Peer(name) && line.threads <= threads;
            let its = self.lines.iter().filter(is_it);
            its.min_by_key(|line| line.rank()).map(|line| (name, line))
        };
        PeerName::value_variants().iter().filter_map(best).collect()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn line(who: Who, threads: usize, median_ns: u64, fault: Option<&str>) -> Line {
        let frame = Spread { median_ns, ..Spread::default() };
        let fault = fault.map(str::to_owned);
        let (late, write) = (frame, Spread::default());
        Line { who, threads, frame, late, write, is_given_up: false, fault }
    }

    /// Two of our lines, a peer that is faster on one thread, one that is slower, and the fastest,
    /// which misses a pair.
    pub fn comparison() -> Comparison {
        let ours = |backend| Who::Ours { backend, engine: "auto:cpu-grid".to_owned() };
        let lines = vec![
            line(ours("daemon"), 1, 60, None),
            line(ours("in-process"), 2, 40, None),
            line(Who::Peer(PeerName::ParryRefit), 1, 100, None),
            line(Who::Peer(PeerName::ParryRefit), 2, 80, None),
            line(Who::Peer(PeerName::ParryOptimize), 1, 400, None),
            line(Who::Peer(PeerName::ParryOptimize), 2, 500, None),
            line(Who::Peer(PeerName::Rapier), 1, 10, Some("a pair is missing")),
        ];
        Comparison { scene: SceneName::Pile, n: 1_000, pairs: 7_000, lines }
    }

    #[test]
    fn each_of_our_lines_meets_each_peer_at_its_best() {
        let whole = comparison();
        let rows = whole.rows();
        let seen: Vec<_> = rows
            .iter()
            .map(|r| {
                let equal = r.are_pairs_equal();
                (r.backend, r.peer, r.theirs.threads, r.ratios()[0], r.is_best_peer, equal)
            })
            .collect();
        let (refit, optimize, rapier) =
            (PeerName::ParryRefit, PeerName::ParryOptimize, PeerName::Rapier);
        assert_eq!(
            seen,
            [
                ("daemon", refit, 1, 0.6, true, true),
                ("daemon", optimize, 1, 0.15, false, true),
                ("daemon", rapier, 1, 6.0, false, false),
                ("in-process", refit, 2, 0.5, true, true),
                ("in-process", optimize, 1, 0.1, false, true),
                ("in-process", rapier, 1, 4.0, false, false),
            ]
        );
        let mut comparison = comparison();
        comparison.lines[0].fault = Some("a pair is missing".to_owned());
        let rows = comparison.rows();
        assert!(rows.iter().all(|row| row.backend != "daemon" || !row.are_pairs_equal()));
        assert!(comparison.is_wrong());
    }
}
