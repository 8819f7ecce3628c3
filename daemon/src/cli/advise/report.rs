//! What `advise` shows: the figures as a table and as JSON, what follows, and the code.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::advise::{Advice, Figures, Sample, Takeover, Way, Workload, lines, take_overs};
use crate::cli::machine::Machine;
use crate::cli::output::time_text;
use crate::shown::Shown;

/// Rows of the table, so that all of it is seen on a terminal of 24 lines.
const FEW_ROWS: usize = 5;
/// Columns of a terminal that every line fits.
const COLUMNS: usize = 80;

pub struct Report<'a> {
    pub name: &'a str,
    pub machine: &'a Machine,
    pub workload: &'a Workload,
    pub advice: &'a Advice,
}

/// A number with commas between thousands.
pub fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let from_end = |at: usize| digits.len() - at;
    digits.char_indices().fold(String::new(), |mut text, (at, digit)| {
        if at > 0 && from_end(at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
        text
    })
}

impl Report<'_> {
    pub fn best(&self) -> &Sample {
        &self.advice.samples[self.advice.best]
    }

    /// What the work is, in a line.
    pub fn work(&self) -> String {
        let mut text = format!("{}: {} boxes", self.name, grouped(self.workload.boxes()));
        if let Some(moving) = self.workload.moving() {
            let percent = 100.0 * moving;
            let _ = write!(text, ", {percent:.0} % move a tick");
        }
        let ticks = self.workload.ticks();
        let pairs = self.best().figures.pairs as usize;
        let _ = write!(text, "; {} pairs reported a tick; {ticks} ticks", grouped(pairs));
        text
    }

    pub fn machine_line(&self) -> String {
        let Machine { cpu, cores, .. } = self.machine;
        format!("{cpu}, {cores} cores")
    }

    /// The advice, and what it is better than.
    pub fn verdict(&self) -> String {
        let best = self.best();
        let mut text = format!("advice: {}, {} a tick", best.way, time_text(best.figures.usual_ns));
        let plain = self.advice.plainest.map(|at| &self.advice.samples[at]);
        if let Some(plain) = plain.filter(|plain| plain.way != best.way) {
            let times = plain.figures.usual_ns as f64 / best.figures.usual_ns.max(1) as f64;
            let _ = write!(text, ", {times:.1} times as fast as {}", plain.way);
        }
        text
    }

    /// What near pairs would save, where that is much.
    pub fn near(&self) -> Option<String> {
        let near = &self.advice.samples[self.advice.near?];
        let share = near.figures.usual_ns as f64 / self.best().figures.usual_ns.max(1) as f64;
        let time = time_text(near.figures.usual_ns);
        (share < 0.9).then(|| format!("where near pairs do no harm: {}, {time}", near.way))
    }

    /// From how many boxes on another host is the best one.
    pub fn sizes(&self) -> Option<String> {
        let sizes = &self.advice.sizes;
        let (most, _) = sizes.rows.last()?;
        let found = take_overs(sizes);
        let host = |takeover: &Takeover| host_text(&sizes.ways[takeover.way]);
        let text = match &found[..] {
            [] => return None,
            [only] => format!("{} is the best at every size up to {}", host(only), grouped(*most)),
            [first, others @ ..] => {
                let from = |t: &Takeover| format!("{} from {} boxes", host(t), grouped(t.from));
                let others: Vec<String> = others.iter().map(from).collect();
                format!("{}, then {}", host(first), others.join(", "))
            }
        };
        Some(format!("sizes: {text}"))
    }

    pub fn shown(&self, all: bool) -> Shown {
        Shown { fields: self.fields(), text: self.text(all) }
    }

    // Writing to a string cannot fail.
    fn text(&self, all: bool) -> String {
        let mut text = format!("{}\n{}\n", wrapped(&self.work()), wrapped(&self.machine_line()));
        for note in &self.workload.notes {
            let _ = writeln!(text, "{}", wrapped(note));
        }
        let _ = writeln!(
            text,
            "\n  {:<27}{:<17}{:>7}{:>9}{:>9}{:>9}",
            "what", "who", "threads", "a tick", "p99", "cpu"
        );
        let rows = self.rows(all);
        for at in &rows {
            let _ = writeln!(text, "{}", self.row(*at));
        }
        let left_out = self.advice.samples.len() - rows.len();
        let _ = match left_out {
            0 => Ok(()),
            1 => writeln!(text, "  1 other way: --all"),
            _ => writeln!(text, "  {left_out} other ways: --all"),
        };
        for failed in &self.advice.failed {
            let _ = writeln!(text, "{}", wrapped(&format!("left out: {failed}")));
        }
        text.push('\n');
        let said = [Some(self.verdict()), self.near(), self.sizes()];
        said.into_iter().flatten().for_each(|line| {
            let _ = writeln!(text, "{}", wrapped(&line));
        });
        text.push('\n');
        let code = lines(&self.best().way, self.workload);
        let code: Vec<String> = code.iter().map(|line| format!("    {line}")).collect();
        text + &code.join("\n")
    }

    /// The rows of the table: the advice first, then others by their time. Where not all are listed, the fastest one of each
    /// host is, and with each thing to send.
    pub fn rows(&self, all: bool) -> Vec<usize> {
        let Advice { samples, best, near, plainest, .. } = self.advice;
        let mut by_time: Vec<usize> = (0..samples.len()).collect();
        by_time.sort_by_key(|at| samples[*at].figures.usual_ns);
        let kind = |at: &usize| (samples[*at].way.host, samples[*at].way.what());
        let mut rows = vec![*best];
        let mut add = |at: &usize, is_new: &dyn Fn(&usize) -> bool| {
            if !rows.contains(at) && rows.iter().all(is_new) {
                rows.push(*at);
            }
        };
        for at in &by_time {
            add(at, &|row| kind(row).0 != kind(at).0);
        }
        [near, plainest].into_iter().flatten().for_each(|at| add(at, &|_| true));
        for at in &by_time {
            add(at, &|row| kind(row).1 != kind(at).1);
        }
        for at in &by_time {
            add(at, &|_| true);
        }
        rows.truncate(if all { usize::MAX } else { FEW_ROWS });
        rows[1..].sort_by_key(|at| samples[*at].figures.usual_ns);
        rows
    }

    fn row(&self, at: usize) -> String {
        let Sample { way, figures, .. } = &self.advice.samples[at];
        let mark = if at == self.advice.best { '>' } else { ' ' };
        let Figures { usual_ns, p99_ns, cpu_ns, .. } = *figures;
        let [usual, p99, cpu] = [usual_ns, p99_ns, cpu_ns].map(time_text);
        let (what, who, threads) = (way.what(), way.who(), way.threads_text());
        format!("{mark} {what:<27}{who:<17}{threads:>7}{usual:>9}{p99:>9}{cpu:>9}")
    }

    fn fields(&self) -> Value {
        let Advice { samples, best, near, plainest, sizes, failed } = self.advice;
        let times = |(n, ns): &(usize, Vec<u64>)| {
            let ways = sizes.ways.iter().zip(ns);
            let ways: Vec<Value> =
                ways.map(|(way, ns)| json!({ "way": way.to_string(), "usual_ns": ns })).collect();
            json!({ "boxes": n, "ways": ways })
        };
        let take_over =
            |t: &Takeover| json!({ "way": sizes.ways[t.way].to_string(), "from_boxes": t.from });
        json!({
            "machine": self.machine,
            "file": self.name,
            "boxes": self.workload.boxes(),
            "moving": self.workload.moving(),
            "ticks": self.workload.ticks(),
            "notes": self.workload.notes,
            "advice": samples[*best].way.to_string(),
            "near": near.map(|at| samples[at].way.to_string()),
            "plainest": plainest.map(|at| samples[at].way.to_string()),
            "rows": samples.iter().map(fields_of).collect::<Vec<_>>(),
            "failed": failed,
            "sizes": sizes.rows.iter().map(times).collect::<Vec<_>>(),
            "take_overs": take_overs(sizes).iter().map(take_over).collect::<Vec<_>>(),
            "code": lines(&samples[*best].way, self.workload),
        })
    }
}

fn fields_of(Sample { way, figures, rounds }: &Sample) -> Value {
    let Figures { ticks, usual_ns, p50_ns, p99_ns, cpu_ns, pairs } = figures;
    json!({
        "way": way.to_string(),
        "what": way.what(),
        "who": way.who(),
        "threads": way.threads,
        "may_be_near": way.is_near(),
        "rounds": rounds,
        "ticks": ticks,
        "usual_ns": usual_ns,
        "p50_ns": p50_ns,
        "p99_ns": p99_ns,
        "cpu_ns": cpu_ns,
        "pairs": pairs,
    })
}

/// A way without what is sent.
pub fn host_text(way: &Way) -> String {
    match way.threads {
        None => way.who(),
        Some(1) => format!("{} with 1 thread", way.who()),
        Some(threads) => format!("{} with {threads} threads", way.who()),
    }
}

/// Words in lines that fit; those behind the first one are indented.
fn wrapped(text: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        if let Some(line) = lines.last_mut() {
            let is_first = line.trim().is_empty();
            if is_first || line.chars().count() + word.chars().count() < COLUMNS {
                line.push_str(if is_first { "" } else { " " });
                line.push_str(word);
                continue;
            }
        }
        lines.push(format!("  {word}"));
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_fit_a_terminal_and_numbers_are_grouped() {
        let text = "a word ".repeat(40);
        let lines = wrapped(text.trim());
        assert!(lines.lines().count() > 3 && lines.lines().all(|line| line.len() <= COLUMNS));
        assert_eq!(lines.split_whitespace().count(), 80);
        assert!(
            lines.lines().skip(1).all(|line| line.starts_with("  a") || line.starts_with("  w"))
        );
        assert_eq!(
            [7, 1_000, 12_345, 1_234_567].map(grouped).join(" "),
            "7 1,000 12,345 1,234,567"
        );
    }
}
