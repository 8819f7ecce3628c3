//! The report: as values, CSV, JSON and Markdown.

mod csv;
mod markdown;

use std::fs;
use std::path::Path;

use serde::Serialize;

use super::MappingError;
use super::claims::Claim;
use super::rows::{
    FirstWrongRow, GrowthRow, MapTimeRow, OutputRow, PairErrorRow, RootErrorRow, RootTimeRow,
};
use crate::study::machine::Machine;

pub use csv::csv;
pub use markdown::markdown;

/// All figures of a study.
#[derive(Clone, Debug, Serialize)]
pub struct MappingReport {
    /// The machine of the study.
    pub machine: Machine,
    /// The paper's claims, judged.
    pub claims: Vec<Claim>,
    /// Table 3.
    pub root_errors: Vec<RootErrorRow>,
    /// Wrong, missed and repeated pairs.
    pub pair_errors: Vec<PairErrorRow>,
    /// Fewest boxes for which a closed form is wrong.
    pub first_wrong: Vec<FirstWrongRow>,
    /// Table 2, with every variant.
    pub map_times: Vec<MapTimeRow>,
    /// Table 4.
    pub root_times: Vec<RootTimeRow>,
    /// Table 5.
    pub outputs: Vec<OutputRow>,
    /// Figure 4.
    pub growth: Vec<GrowthRow>,
}

/// The report as JSON.
///
/// # Errors
/// As `serde_json`: none for this type.
pub fn json(report: &MappingReport) -> Result<String, serde_json::Error> {
    serde_json::to_string_pretty(report)
}

/// Writes `mapping.csv`, `mapping.json` and `mapping.md` into a folder, which is made.
///
/// # Errors
/// [`MappingError::Write`], [`MappingError::Json`].
pub fn write_files(report: &MappingReport, folder: &Path) -> Result<(), MappingError> {
    let json = json(report)? + "\n";
    let written = fs::create_dir_all(folder)
        .and_then(|()| fs::write(folder.join("mapping.csv"), csv(report)))
        .and_then(|()| fs::write(folder.join("mapping.json"), json))
        .and_then(|()| fs::write(folder.join("mapping.md"), markdown(report)));
    written.map_err(|error| MappingError::Write { folder: folder.to_owned(), error })
}
