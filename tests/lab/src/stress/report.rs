//! The report of a run: as text, and as the JSON that the README documents.

use std::fmt;

use pairmaskd::shown::Shown;
use serde::Serialize;

use super::MOST_FAILURES;
use super::answer::{Finding, Form};
use super::case::Case;
use super::clients::ClientsReport;

/// The JSON object of `stress --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StressReport {
    pub seed: u64,
    pub subjects: Vec<String>,
    pub cases: u64,
    pub answers: u64,
    pub skipped: Vec<Skipped>,
    pub missed: u64,
    pub extra: u64,
    pub elapsed_ns: u64,
    pub failures: Vec<Failure>,
    pub clients: Option<ClientsReport>,
}

/// Answers that a subject declined because too many boxes lay in one place.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Skipped {
    pub subject: String,
    pub answers: u64,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Failure {
    pub case: u64,
    pub subject: String,
    pub mode: &'static str,
    pub replay: String,
    pub boxes: u64,
    pub scene: String,
    pub flags: String,
    #[serde(flatten)]
    pub found: Finding,
    pub explain: Option<Shown>,
}

impl Failure {
    pub fn new(case: &Case, form: Form, subject: String, replay: String, found: Finding) -> Self {
        let (boxes, scene) = match form {
            Form::Spheres => (case.spheres().spheres.len(), "spheres"),
            Form::Mode(usage) => (case.in_mode(usage).given.len(), &case.recipe[..]),
            _ => (case.boxes.len(), &case.recipe[..]),
        };
        Self {
            case: case.seed,
            subject,
            mode: form.mode(),
            replay,
            boxes: boxes as u64,
            scene: scene.to_owned(),
            flags: case.flags.to_string(),
            explain: found.pair.and_then(|pair| case.explain(form, pair)),
            found,
        }
    }
}

impl StressReport {
    pub(super) fn new(seed: u64, subjects: Vec<String>) -> Self {
        Self { seed, subjects, ..Self::default() }
    }

    pub(super) fn skip(&mut self, subject: &str) {
        match self.skipped.iter_mut().find(|skipped| skipped.subject == subject) {
            Some(skipped) => skipped.answers += 1,
            None => self.skipped.push(Skipped { subject: subject.to_owned(), answers: 1 }),
        }
    }

    /// Counts a wrong answer, and keeps the first ten.
    pub(super) fn fail(&mut self, failure: Failure) {
        self.missed += failure.found.missed;
        self.extra += failure.found.extra;
        if self.failures.len() < MOST_FAILURES {
            self.failures.push(failure);
        }
    }

    pub fn checked(&self) -> u64 {
        self.answers - self.skipped.iter().map(|skipped| skipped.answers).sum::<u64>()
    }

    /// Whether there was an answer, all answers were right, and clients got theirs from the daemon.
    pub fn is_clean(&self) -> bool {
        let are_clients_clean = self.clients.as_ref().is_none_or(ClientsReport::is_clean);
        self.failures.is_empty() && self.checked() > 0 && are_clients_clean
    }
}

impl fmt::Display for StressReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for failure in &self.failures {
            writeln!(f, "{failure}")?;
        }
        for Skipped { subject, answers } in &self.skipped {
            writeln!(f, "skipped: {subject}: {answers} cases, too many boxes in one place")?;
        }
        let Self { seed, cases, answers, missed, extra, .. } = self;
        let seconds = self.elapsed_ns as f64 / 1e9;
        if let Some(clients) = &self.clients {
            writeln!(f, "{clients}")?;
            write!(f, "seed {seed}: {cases} cases, {answers} answers in {seconds:.1} s; ")?;
        } else {
            let minute = 60.0 * *cases as f64 / seconds.max(1e-9);
            write!(f, "seed {seed}: {cases} cases × {} subjects", self.subjects.len())?;
            write!(f, " = {answers} answers in {seconds:.1} s ({minute:.0} cases a minute); ")?;
        }
        let skipped = answers - self.checked();
        if skipped > 0 {
            write!(f, "{skipped} skipped, ")?;
        }
        match self.failures.len() {
            _ if self.checked() == 0 => f.write_str("nothing was checked"),
            0 => f.write_str("0 missed, 0 extra"),
            wrong => {
                write!(f, "{wrong} wrong answers shown, {missed} missed and {extra} extra pairs")
            }
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { subject, mode, boxes, scene, flags, replay, found, .. } = self;
        writeln!(f, "WRONG: {subject}\n  {}\n  mode {mode}\n  {boxes} boxes: {scene}", found.what)?;
        writeln!(f, "  floating-point flags: {flags}\n  again: {replay}")?;
        if let Some(explain) = &self.explain {
            writeln!(f)?;
            for line in explain.to_string().lines() {
                if line.is_empty() { writeln!(f)? } else { writeln!(f, "  {line}")? }
            }
        }
        Ok(())
    }
}
