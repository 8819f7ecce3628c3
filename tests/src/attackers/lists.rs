//! A daemon that writes to a list of pairs while the client reads it.

use std::error::Error;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::StageTimes;
use pairmask_core::engine::{Census, CullReport, EngineName, EngineTimes, SkipMeter};
use pairmask_core::mask::MaskShape;
use pairmask_transport::{DaemonRecord, Limits, RuntimeDir, Services, assume_response_pages};
use pairmask_wire::{InstanceName, Version, response_ok};

use super::raw::{Dice, write};
use super::{Tally, Until, count};
use crate::refuser::fields_of;

/// Pairs of a list: a page of them.
pub const PAIRS: u64 = 512;

pub(super) fn attack(until: &Until, tally: &mut Tally) -> Result<(), Box<dyn Error>> {
    let (dir, name) = (RuntimeDir::from_env(), InstanceName::default());
    let limits = Limits { max_reply_bytes: 4096, ..Limits::default() };
    dir.ensure()?;
    dir.ensure_transport_root(&name)?;
    let services = Services::serve(&dir, &name, &limits)?;
    let server = services.server(&limits, &std::sync::Arc::default())?;
    let ports = services.wake_ports()?;
    let pid = std::process::id();
    let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version: Version::CURRENT };
    dir.write_record(&name, &record)?;
    let mut dice = Dice::of_this_process();
    while !until.is_over() {
        let Ok(Some(request)) = server.receive() else {
            std::thread::sleep(Duration::from_micros(50));
            continue;
        };
        let asked = *request.user_header();
        let Ok(loan) = request.loan_slice_uninit(1) else { continue };
        let mut loan = assume_response_pages(loan);
        let list = loan.payload_mut().as_ptr() as usize;
        let pair = |a: u64, b: u64| a | b << 32;
        for number in 0..PAIRS {
            write(list + 8 * number as usize, pair(number, number + 1));
        }
        let report = CullReport {
            shape: MaskShape::list(PAIRS),
            census: Census::default(),
            pair_count: PAIRS,
            skipped: SkipMeter::default(),
            times: EngineTimes::default(),
        };
        let times = StageTimes::default();
        *loan.user_header_mut() =
            response_ok(&fields_of(&asked), EngineName::CpuBrute, 1, &report, &times);
        if loan.send().is_err() {
            continue;
        }
        count(tally, "rounds");
        let _ = ports.1.notify();
        // Pairs and what is none in turn, while the client reads. The memory is this process's as long
        // as the port lives.
        let end = Instant::now() + Duration::from_millis(2);
        while Instant::now() < end {
            for _ in 0..64 {
                let number = dice.below(PAIRS);
                let address = list + 8 * number as usize;
                let forged = match dice.below(4) {
                    0 => u64::MAX,
                    1 => pair(number + 1, number),
                    2 => pair(number, u64::from(asked.box_count)),
                    _ => dice.below(u64::MAX),
                };
                write(address, forged);
                write(address, pair(number, number + 1));
                write(address, forged);
            }
            for number in 0..PAIRS {
                write(list + 8 * number as usize, pair(number, number + 1));
            }
        }
    }
    dir.remove_record(&name);
    Ok(())
}
