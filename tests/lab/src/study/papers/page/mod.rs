//! The page: Markdown, and HTML that loads nothing.

mod html;
mod markdown;

pub use self::html::html;
pub use self::markdown::markdown;

use super::model::{Row, figure};
use super::report::PapersReport;

/// How the page is to be read, one sentence each.
const HOW_TO_READ: [&str; 3] = [
    "Each claim of a table or figure has a rule, and the rule alone gives the verdict: it holds where \
     all its figures are there and keep the rule, it breaks where one does not, and it is not measured \
     where a figure is missing.",
    "Ours are times of machines of today: a time that is reached says that nothing was lost since, a \
     ratio of two times of one machine says more.",
    "Figures of one claim are of one source: this run where it has as many of them as a record, else \
     the newest record that has most.",
];

/// What the page was made of.
fn made_of(report: &PapersReport) -> String {
    let machine = &report.machine;
    if report.only_records {
        return format!("Made of records alone; commit {}.", machine.commit);
    }
    let (cpu, threads, commit) = (&machine.cpu, machine.threads, &machine.commit);
    let debug =
        if machine.optimised { "" } else { " The build is not optimised: times mean little." };
    format!("This run: {cpu}, {threads} threads, commit {commit}.{debug}")
}

/// A row's cells: what, paper, ours, ratio, source.
fn cells(row: &Row) -> [String; 5] {
    let with_unit = |x: Option<f64>| match x {
        Some(x) if row.unit.is_empty() => figure(x),
        Some(x) => format!("{} {}", figure(x), row.unit),
        None => "-".to_owned(),
    };
    [
        row.what.clone(),
        with_unit(row.paper),
        with_unit(row.ours),
        row.ratio.map_or_else(|| "-".to_owned(), figure),
        row.from.clone().unwrap_or_else(|| "-".to_owned()),
    ]
}
