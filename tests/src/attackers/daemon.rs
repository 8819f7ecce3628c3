//! A daemon that states places of answers beyond its memory.

use std::error::Error;
use std::time::Duration;

use pairmask_core::mask::Encoding;
use pairmask_wire::board::Placed;
use pairmask_wire::{
    RESPONSE_MAGIC, ResponseHeader, Section, SectionKind, StatusCode, VERSION_MAJOR, VERSION_MINOR,
};

use super::raw::{dice, write};
use super::{Tally, Until, serve, while_they_alternate};

pub fn attack(until: &Until, tally: &mut Tally) -> Result<(), Box<dyn Error>> {
    let mut dice = dice();
    serve(until, tally, |mut request| {
        let asked = request.header;
        let pairs = u64::from(asked.box_count) * (u64::from(asked.box_count) - 1) / 2;
        let bytes = pairs.div_ceil(32) * 4;
        let mut header = ResponseHeader {
            magic: RESPONSE_MAGIC,
            version_major: VERSION_MAJOR,
            version_minor: VERSION_MINOR,
            status: StatusCode::Ok as u32,
            client_token: asked.client_token,
            frame: asked.frame,
            box_count: asked.box_count,
            engine: 1,
            encoding: Encoding::Dense as u32,
            pair_count: pairs,
            ..ResponseHeader::default()
        };
        header.sections[0] = Section::required(SectionKind::DenseWords, 0, bytes);
        let right = request.placed;
        let pages = match dice.below(4) {
            0 => u64::MAX,
            1 => (1 << 52) + bytes.div_ceil(4096),
            _ => bytes.div_ceil(4096),
        };
        request.placed = match dice.below(4) {
            0 => Placed { segment: dice.below(u64::MAX), ..right },
            1 => Placed { offset: dice.below(u64::MAX), ..right },
            _ => Placed { pages, ..right },
        };
        request.answer(header);
        // The length alternates between forged and true while clients read it.
        let at = request.board.entry(request.place) + 16;
        let states: [&(dyn Fn() + Sync); 2] = [&|| write(at, right.pages), &|| write(at, pages)];
        while_they_alternate(dice.below(2) > 0, states, || {
            std::thread::sleep(Duration::from_millis(1));
        });
    })
}
