//! `doctor`: what of this machine keeps a daemon or its clients from working well, and what to do about it.
//!
//! [`read`](mod@read) collects [`facts`], and [`judge`](mod@judge) judges them without another look at the machine.

mod bundle;
mod facts;
mod judge;
mod judge_gpus;
mod read;
#[cfg(test)]
mod tests;

use std::fmt::Write;
use std::num::NonZeroU16;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use self::facts::Facts;
use self::judge::{Check, Finding, Level, judge, seen};
use self::read::{Serving, read};
use super::memory_size::MemorySize;
use super::options::{CommonOptions, DaemonOptions};
use super::output::{is_stdout, print_json, print_text, write_file};
use super::program::{Result, WrongUsage};
use super::progress::spinner;
use super::whole_number::whole_number;
use crate::serve::DaemonSettings;

/// Check this machine, and say what to do about what is wrong
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd doctor
  pairmaskd doctor --max-clients 500   for a daemon that is to be served so
  pairmaskd doctor --bundle bug.txt    also what a bug report needs

A warning is about what works, and could work better.
Exit status: 0 without problems, 1 with one.")]
pub struct Doctor {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Write a file for a bug report: this report, the status of instances, the variables PAIRMASK_*, and what
    /// machine this is; `-` for stdout
    #[arg(long, value_name = "FILE")]
    bundle: Option<PathBuf>,
    /// Clients at a time that a daemon shall have room for [default: 100]
    #[arg(long, value_parser = whole_number::<NonZeroU16>, env = "PAIRMASK_MAX_CLIENTS", value_name = "N")]
    max_clients: Option<NonZeroU16>,
    /// Memory that a daemon may take [default: as of `serve`]
    #[arg(long, env = "PAIRMASK_MAX_MEMORY", value_name = "SIZE")]
    max_memory: Option<MemorySize>,
    #[command(flatten)]
    options: DaemonOptions,
}

impl Doctor {
    pub fn run(&self, common: &CommonOptions) -> Result {
        let is_on_stdout = self.bundle.as_deref().is_some_and(is_stdout);
        if is_on_stdout && self.json {
            let both =
                "--json and --bundle would both write to stdout: name a file for one of them";
            return Err(WrongUsage(both.to_owned()).into());
        }
        let progress = spinner("looking at this machine");
        let facts = read(common, &self.serving(common));
        progress.finish_and_clear();
        let findings = judge(&facts);
        if let Some(path) = &self.bundle {
            let bundle = bundle::text(&text(&facts, &findings), common);
            write_file(path, |file| file.write_all(bundle.as_bytes()))?;
        }
        if self.json {
            print_json(&report(&facts, &findings))?;
        } else if !is_on_stdout {
            print_text(&text(&facts, &findings))?;
        }
        match count(&findings, Level::Problem) {
            0 => Ok(()),
            1 => Err("there is a problem: see what the report says to do".into()),
            n => Err(format!("there are {n} problems: see what the report says to do").into()),
        }
    }

    fn serving(&self, common: &CommonOptions) -> Serving {
        let default = DaemonSettings::default().limits;
        let max_clients = self.max_clients.or(common.file.max_clients);
        let max_memory = self.max_memory.or(common.file.max_memory);
        Serving {
            max_clients: max_clients.map_or(default.max_clients, |n| usize::from(n.get())),
            max_memory_bytes: max_memory.map_or(default.max_memory_bytes, |size| size.0),
            gpus: self.options.gpus(common),
        }
    }
}

fn count(findings: &[Finding], level: Level) -> usize {
    findings.iter().filter(|finding| finding.level == level).count()
}

/// Each check in its order, with its findings; one without has `None`.
fn results(findings: &[Finding]) -> impl Iterator<Item = (Check, Option<&Finding>)> {
    Check::ALL.into_iter().flat_map(move |check| {
        let mut of_it: Vec<_> =
            findings.iter().filter(|finding| finding.check == check).map(Some).collect();
        if of_it.is_empty() {
            of_it.push(None);
        }
        of_it.into_iter().map(move |finding| (check, finding))
    })
}

/// The object of `doctor --json`, whose fields `CLI.md` explains. Fields may be added, never changed or taken away.
fn report(facts: &Facts, findings: &[Finding]) -> Value {
    let check = |(check, finding): (Check, Option<&Finding>)| {
        let state = finding.map_or(json!("ok"), |finding| json!(finding.level));
        json!({
            "check": check,
            "state": state,
            "seen": seen(check, facts),
            "cause": finding.map(|finding| &finding.cause),
            "cure": finding.map(|finding| &finding.cure),
        })
    };
    json!({
        "problems": count(findings, Level::Problem),
        "warnings": count(findings, Level::Warning),
        "checks": results(findings).map(check).collect::<Vec<_>>(),
    })
}

fn text(facts: &Facts, findings: &[Finding]) -> String {
    let mut text = String::new();
    for (check, finding) in results(findings) {
        let title = check.title();
        // Writing to a string cannot fail.
        let _ = match finding {
            None => writeln!(text, "ok       {title}: {}", seen(check, facts)),
            Some(Finding { level, cause, cure, .. }) => {
                let level = if *level == Level::Problem { "problem" } else { "warning" };
                writeln!(text, "{level:8} {title}: {cause}\n         → {cure}")
            }
        };
    }
    let counted = |level: Level, name: &str| match count(findings, level) {
        1 => format!("1 {name}"),
        count => format!("{count} {name}s"),
    };
    let (problems, warnings) = (Level::Problem, Level::Warning);
    let _ = write!(text, "{}, {}", counted(problems, "problem"), counted(warnings, "warning"));
    text
}
