//! A client that keeps requests waiting on all its connections, under tokens of its choice.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use pairmask_core::engine::{EngineChoice, EngineName};
use pairmask_wire::RequestHeader;

use super::raw::{RawClient, RawPending, cull};
use super::{Tally, Until, count};

/// Boxes of a frame, all empty, and pages for them: a frame takes longer than a client's way back.
const BOXES: u32 = 2_000;
const PAGES: usize = 2_000 * 24 / 4096 + 1;
const AT_A_TIME: usize = 3;

/// With a token for each request, the one after the last: it would be served next by a daemon that serves tokens in a
/// circle.
pub fn attack(ports: u64, is_next: bool, until: &Until, tally: &mut Tally) {
    let mut next = 1 << 40;
    let clients: Vec<RawClient> = (0..ports).filter_map(|_| RawClient::connect(PAGES)).collect();
    println!("connected={}", clients.len());
    let mut waiting: Vec<VecDeque<RawPending<'_>>> =
        clients.iter().map(|_| VecDeque::new()).collect();
    let mut frame = 0;
    while !until.is_over() {
        let mut moved = false;
        for (port, (client, waiting)) in clients.iter().zip(&mut waiting).enumerate() {
            if waiting.front().is_some_and(RawPending::is_answered) {
                waiting.pop_front();
                count(tally, "answered");
                moved = true;
            }
            while waiting.len() < AT_A_TIME {
                let Some(mut loan) = client.loan() else { break };
                next += u64::from(is_next);
                let token = next + port as u64;
                frame += 1;
                let engine = EngineChoice::Only(EngineName::CpuSap);
                loan.header = RequestHeader { client_token: token, ..cull(frame, BOXES, engine) };
                waiting.push_back(client.send(loan));
                moved = true;
            }
        }
        if !moved {
            std::thread::sleep(Duration::from_micros(20));
        }
    }
    // The answers of requests under way are dropped; the daemon gets a moment to notice.
    drop(waiting);
    let end = Instant::now() + Duration::from_millis(50);
    while Instant::now() < end {
        std::thread::sleep(Duration::from_millis(10));
    }
}
