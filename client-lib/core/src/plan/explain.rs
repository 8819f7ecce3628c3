//! Why a plan is what it is, in words.

use std::fmt;

use super::Plan;
use crate::engine::EngineChoice;

impl Plan {
    /// Why this engine, in three words.
    pub const fn why(&self) -> &'static str {
        match self.options.engine {
            EngineChoice::Auto => "least predicted time",
            EngineChoice::Only(_) => "asked for",
        }
    }

    /// Why, in a few lines for a terminal.
    pub fn explain(&self) -> impl fmt::Display + '_ {
        Explanation(self)
    }
}

struct Explanation<'a>(&'a Plan);

impl fmt::Display for Explanation<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Plan { engine, encoding, threads, candidates, stats, .. } = self.0;
        if stats.is_looked_at {
            writeln!(
                f,
                "{} boxes, {:.0} % valid, median size {}, 90 % below {}, sweep window {:.3} % of them, elongation {:.1}, {:.0} pairs expected",
                stats.n.get(),
                100.0 * stats.valid_share,
                stats.median_size,
                stats.large_size,
                100.0 * stats.window_share,
                stats.elongation,
                stats.expected_pairs(),
            )?;
        } else {
            writeln!(
                f,
                "{} boxes, not worth a look, {:.0} pairs expected",
                stats.n.get(),
                stats.expected_pairs()
            )?;
        }
        for candidate in candidates.iter().flatten() {
            let mark = if candidate.engine == *engine { "->" } else { "  " };
            writeln!(
                f,
                "{mark} {:<10} {:<6} {} threads  {:>12.1} µs predicted, {:.1} of them to iterate over the pairs",
                candidate.engine.as_str(),
                candidate.encoding.as_str(),
                candidate.threads,
                candidate.predicted_ns / 1e3,
                candidate.iterate_ns / 1e3,
            )?;
        }
        write!(f, "{engine}, {encoding}, {threads} threads: {}", self.0.why())
    }
}
