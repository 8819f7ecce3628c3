//! The report: its JSON, CSV, and Markdown.

use serde::Serialize;

use super::{MapTimeRow, PairErrorRow};
use crate::study::harness::Report;
use crate::study::harness::document::Part;
use crate::study::harness::machine::Machine;
use crate::study::harness::table::Fields;

/// All figures of a study.
#[derive(Clone, Debug, Serialize)]
pub struct MappingReport {
    pub machine: Machine,
    pub claims: Vec<Fields>,
    pub root_errors: Vec<Fields>,
    pub pair_errors: Vec<PairErrorRow>,
    pub first_wrong: Vec<Fields>,
    pub map_times: Vec<MapTimeRow>,
    pub root_times: Vec<Fields>,
    pub outputs: Vec<Fields>,
    pub growth: Vec<Fields>,
}

impl Report for MappingReport {
    const NAME: &'static str = "mapping";

    fn parts(&self) -> Vec<Part> {
        let mut parts = vec![
            Part::heading(1, "The mapping function: run time against error"),
            Part::text(
                "Avril, Gouranton and Arnaldi, EGPGV 2012, §3, measured again. `paper_` are the paper's \
                 figures (Quadro FX 3600M, Core 2 Duo X7900).",
            ),
        ];
        parts.extend(self.machine.parts());
        let sections = [
            Part::section("What holds and what breaks", "", &self.claims),
            Part::section(
                "Numbers of boxes from which a row starts or ends wrongly",
                "By the f32 arithmetic of a CPU (correctly rounded, no fused operations).",
                &self.first_wrong,
            ),
            Part::section(
                "Table 3: integer parts of roots that are wrong",
                "Of √1 to √N in f32, against the built-in root of the same processor (`other`) and the exact \
                 integer root (`inexact`). The paper says that four steps give the figures of three.",
                &self.root_errors,
            ),
            Part::section(
                "Wrong pairs by number of boxes",
                "Ids that are mapped to another pair or to none, the largest distance from the right row, and \
                 shares of pairs that are missed and tested again. Beside a sample, the first and last id of \
                 every row are looked at (on the GPU 16 on either side). Ids are counted in the variant's own \
                 order (fold, lazy); on the GPU they have 32 bits as long as they fit, then 64.",
                &self.pair_errors,
            ),
            Part::section(
                "Table 2: time to map all ids, ms",
                "With the paper's closed form (`closed sqrt`), the lazy way, and all others. One thread of \
                 the GPU takes 32 ids. CPU times past 2^24 ids are scaled up from so many. Where there is no \
                 time, it would take longer than the study waits. The paper's kernel tests boxes too, and its \
                 times grow as n and not as n², so only the ratio compares.",
                &self.map_times,
            ),
            Part::section(
                "Table 4: time to take roots, ms",
                "The integer parts of √1 to √N, summed. The paper does not say how many steps it timed; \
                 its figure stands beside each.",
                &self.root_times,
            ),
            Part::section(
                "Table 5: one byte or one bit a pair",
                "The corrected closed form, keys in video memory, output copied to host memory. As in the \
                 paper each thread has one pair and ORs its result into the output; beside it, each thread \
                 computes a whole word and no word has two writers. WGSL has no byte stores, so bytes are \
                 written four to a word.",
                &self.outputs,
            ),
            Part::section(
                "Figure 4: kernel, input and output by number of boxes",
                "One bit a pair, one thread a word. The figure has no numbers; table 5's stand here.",
                &self.growth,
            ),
        ];
        parts.extend(sections.concat());
        parts
    }
}
