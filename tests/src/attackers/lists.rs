//! A daemon that writes to a list of pairs while the client reads it.

use std::error::Error;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{Census, CullReport, EngineName, EngineTimes, SkipMeter};
use pairmask_core::mask::MaskShape;
use pairmask_wire::response_ok;

use super::raw::{dice, write};
use super::{Tally, Until, serve};
use crate::refuser::fields_of;

/// Pairs of a list: a page of them.
pub const PAIRS: u64 = 512;

pub(super) fn attack(until: &Until, tally: &mut Tally) -> Result<(), Box<dyn Error>> {
    let mut dice = dice();
    serve(until, tally, |request| {
        let (asked, list) = (&request.header, request.page);
        let pair = |a: u64, b: u64| a | b << 32;
        let write_right = || {
            for number in 0..PAIRS {
                write(list + 8 * number as usize, pair(number, number + 1));
            }
        };
        write_right();
        let report = CullReport {
            shape: MaskShape::list(PAIRS),
            census: Census::default(),
            pair_count: PAIRS,
            skipped: SkipMeter::default(),
            times: EngineTimes::default(),
        };
        let times = StageTimes::default();
        let header = response_ok(&fields_of(asked), EngineName::CpuBrute, 1, &report, &times);
        let box_count = u64::from(asked.box_count);
        request.answer(header);
        // Pairs and what is none in turn, while the client reads.
        let end = Instant::now() + Duration::from_millis(2);
        while Instant::now() < end {
            for _ in 0..64 {
                let number = dice.below(PAIRS);
                let address = list + 8 * number as usize;
                let forged = match dice.below(4) {
                    0 => u64::MAX,
                    1 => pair(number + 1, number),
                    2 => pair(number, box_count),
                    _ => dice.below(u64::MAX),
                };
                write(address, forged);
                write(address, pair(number, number + 1));
                write(address, forged);
            }
            write_right();
        }
    })
}
