//! Requests of this process, whose lengths are kept in private memory.
//!
//! The transport keeps the length of a request in shared memory and makes the payload's slice from it at
//! each access. Any process of the same user can write there. A smaller length would silently take
//! objects, and so pairs, out of a frame; a larger one would reach outside of the memory.
#![allow(unsafe_code)]

use std::{ptr, slice};

use pairmask_wire::{Page, RequestHeader};

use crate::loans::assume_pages;
use crate::message::payload_behind;
use crate::services::{ClientPort, PendingResponse, RequestLoan, ResponseSample, TransportError};

/// Memory for a request.
pub struct OwnRequest {
    loan: RequestLoan,
    pages: usize,
}

impl OwnRequest {
    /// Borrows `pages` pages of a port's memory.
    ///
    /// # Errors
    /// [`TransportError`] where the port has no such chunk left.
    pub fn lend(port: &ClientPort, pages: usize) -> Result<Self, TransportError> {
        let loan = port
            .loan_slice_uninit(pages)
            .map_err(|e| TransportError::new("lending memory for a request", &e))?;
        Ok(Self { loan: assume_pages(loan), pages })
    }

    fn first_page(&self) -> usize {
        payload_behind(ptr::from_ref(self.loan.user_header()))
    }

    /// The pages, as many as were lent.
    pub fn pages(&self) -> &[Page] {
        // SAFETY: so many pages were lent at this place of a mapping, which stays as long as the loan
        // is held; any bytes are a valid Page.
        unsafe {
            slice::from_raw_parts(ptr::with_exposed_provenance(self.first_page()), self.pages)
        }
    }

    /// The pages, writable.
    pub fn pages_mut(&mut self) -> &mut [Page] {
        let first = ptr::with_exposed_provenance_mut(self.first_page());
        // SAFETY: as in `pages`; this process alone uses the loan until it is sent.
        unsafe { slice::from_raw_parts_mut(first, self.pages) }
    }

    /// Sends the request. A port has room for as many requests that the daemon did not receive yet as it
    /// may have under way. Dropped ones count until they are received: so there may be
    /// [no room](SentRequest::is_delivered).
    ///
    /// # Errors
    /// [`TransportError`]; the memory is released then.
    pub fn send(mut self, header: &RequestHeader) -> Result<SentRequest, TransportError> {
        *self.loan.user_header_mut() = *header;
        let first = self.first_page();
        let pending = self.loan.send().map_err(|e| TransportError::new("sending a request", &e))?;
        let mut sent =
            SentRequest { early: None, pending, is_answered: false, first, pages: self.pages };
        // Empties the channel: see `SentRequest`. A transport that fails now will fail later.
        sent.early = sent.receive().unwrap_or_default().map(Box::new);
        Ok(sent)
    }
}

/// A request under way.
///
/// Its channel has room for one response, and the next request that gets the channel finds in it what
/// this one leaves. The transport discards a response for which there is no room. So a request that is
/// dropped takes its response with it, and one that is sent takes away what came at the moment when its
/// predecessor was dropped.
pub struct SentRequest {
    /// The response, where it was there with the first look, which is rare.
    early: Option<Box<ResponseSample>>,
    pending: PendingResponse,
    /// Whether the response was received: there is one for a request.
    is_answered: bool,
    /// Address of the first page.
    first: usize,
    pages: usize,
}

impl SentRequest {
    /// The pages of the request.
    pub fn pages(&self) -> &[Page] {
        // SAFETY: as in `OwnRequest::pages`: the memory of a request is held until `pending` goes.
        unsafe { slice::from_raw_parts(ptr::with_exposed_provenance(self.first), self.pages) }
    }

    /// Whether there was room for the request. One that is not delivered gets no response.
    pub fn is_delivered(&self) -> bool {
        self.pending.number_of_server_connections() > 0
    }

    /// The response, if it has come.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn receive(&mut self) -> Result<Option<ResponseSample>, TransportError> {
        if let Some(early) = self.early.take() {
            return Ok(Some(*early));
        }
        let received =
            self.pending.receive().map_err(|e| TransportError::new("receiving a response", &e))?;
        self.is_answered |= received.is_some();
        Ok(received)
    }
}

impl Drop for SentRequest {
    fn drop(&mut self) {
        if !self.is_answered {
            // Where the transport fails, the channel is of no use any more.
            let _ = self.receive();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loans::assume_response_pages;
    use crate::{
        ActiveRequest, FRAMES_AT_A_TIME, Limits, RuntimeDir, Server, Services, clean_if_abandoned,
    };

    /// Offset of the payload's length in the transport's header of a request, bytes.
    const LENGTH_BYTES: usize = 48;

    /// Writes a length as another process could.
    fn forge(loan: &RequestLoan, length: u64) {
        let header = ptr::from_ref(loan.header()).expose_provenance();
        // SAFETY: the place lies within the header, which is part of a shared mapping and 8-aligned.
        unsafe {
            ptr::with_exposed_provenance_mut::<u64>(header + LENGTH_BYTES).write_volatile(length);
        }
    }

    /// A server, and the services of a client, of a directory of their own.
    fn with_services(what: &str, test: impl FnOnce(&Server, &Services)) {
        let path = std::env::temp_dir().join(format!("pairmask-{what}-{}", std::process::id()));
        let (dir, name) = (RuntimeDir::at(&path), "own".parse().expect("a name"));
        dir.ensure().expect("a directory of our own");
        let limits = Limits::default();
        let services = Services::serve(&dir, &name, &limits).expect("served");
        let server = services.server(&limits, &std::sync::Arc::default()).expect("a server");
        let client_side = Services::connect(&dir, &name).expect("connected");
        test(&server, &client_side);
        drop((client_side, server, services));
        clean_if_abandoned(&dir, &name).expect("no process is left");
        std::fs::remove_dir_all(path).expect("the directory of our own");
    }

    /// As [`with_services`], with a port of that client.
    fn with_both_sides(what: &str, test: impl FnOnce(&Server, &ClientPort)) {
        with_services(what, |server, client_side| {
            test(server, &client_side.client(1, 2).expect("a client").port);
        });
    }

    fn send(port: &ClientPort) -> SentRequest {
        let request = OwnRequest::lend(port, 1).expect("a page");
        request.send(&RequestHeader::status(1, 1)).expect("sent")
    }

    fn taken(server: &Server) -> ActiveRequest {
        server.receive().expect("a server that works").expect("a request")
    }

    fn answer(request: &ActiveRequest) {
        let response = request.loan_slice_uninit(1).expect("a page");
        assume_response_pages(response).send().expect("sent");
    }

    /// A client whose port gets the place of another's, of which the daemon holds a request with the same count.
    #[test]
    fn what_belongs_to_the_last_owner_of_an_address_leaves_the_next_one_alone() {
        with_services("places", |server, client_side| {
            for is_answered in [false, true] {
                let ended = client_side.client_port(2).expect("a port");
                let unread = send(&ended);
                let left = taken(server);
                drop((unread, ended));
                let next = client_side.client_port(2).expect("a port");
                assert!(server.receive().expect("a server that works").is_none());
                let mut read = send(&next);
                assert!(!left.is_connected(), "the daemon answers it to nobody");
                if is_answered {
                    answer(&left);
                }
                drop(left);
                assert!(read.receive().expect("received").is_none(), "another one's answer");
                answer(&taken(server));
                assert!(read.receive().expect("received").is_some());
            }
        });
    }

    /// A client that drops frames unread, and looks for the next answer long after it has come.
    #[test]
    fn a_response_that_was_left_unread_takes_no_room_from_the_next() {
        with_both_sides("unread", |server, port| {
            for round in 0..4 * FRAMES_AT_A_TIME {
                // Requests go through the channels in turn: every channel sees every order.
                for _ in 0..round {
                    let unread = send(port);
                    answer(&taken(server));
                    drop(unread);
                    // Answered after it was dropped.
                    let early = send(port);
                    let request = taken(server);
                    drop(early);
                    answer(&request);
                }
                let mut read = send(port);
                answer(&taken(server));
                assert!(read.receive().expect("received").is_some(), "round {round}");
            }
        });
    }

    /// A client that drops frames faster than the daemon receives them.
    #[test]
    fn a_request_says_whether_there_was_room_for_it() {
        with_both_sides("room", |server, port| {
            for round in 0..3 {
                for _ in 0..FRAMES_AT_A_TIME {
                    assert!(send(port).is_delivered(), "round {round}");
                }
                assert!(!send(port).is_delivered(), "nobody receives");
                // The dropped ones are passed over, and make room.
                assert!(server.receive().expect("a server that works").is_none());
                let mut read = send(port);
                assert!(read.is_delivered(), "round {round}");
                answer(&taken(server));
                assert!(read.receive().expect("received").is_some(), "round {round}");
            }
        });
    }

    #[test]
    fn a_request_keeps_the_length_that_was_lent() {
        with_both_sides("own", |_, port| {
            let mut request = OwnRequest::lend(port, 2).expect("two pages");
            assert_eq!(request.loan.payload().as_ptr(), request.pages().as_ptr());
            for forged in [0, 1, 2, 3] {
                forge(&request.loan, forged);
                assert_eq!(request.loan.payload().len() as u64, forged, "what the transport says");
                assert_eq!((request.pages().len(), request.pages_mut().len()), (2, 2));
            }
            forge(&request.loan, 1);
            let first = request.pages().as_ptr();
            let sent = request.send(&RequestHeader::status(1, 1)).expect("sent");
            assert_eq!(sent.pending.payload().len(), 1, "what the transport says");
            assert_eq!((sent.pages().as_ptr(), sent.pages().len()), (first, 2));
        });
    }
}
