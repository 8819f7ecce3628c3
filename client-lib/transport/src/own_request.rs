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

    /// Sends the request.
    ///
    /// # Errors
    /// [`TransportError`]; the memory is gone then.
    pub fn send(mut self, header: &RequestHeader) -> Result<SentRequest, TransportError> {
        *self.loan.user_header_mut() = *header;
        let first = self.first_page();
        let pending = self.loan.send().map_err(|e| TransportError::new("sending a request", &e))?;
        Ok(SentRequest { pending, first, pages: self.pages })
    }
}

/// A request under way.
pub struct SentRequest {
    pending: PendingResponse,
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

    /// The response, if it has come.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn receive(&self) -> Result<Option<ResponseSample>, TransportError> {
        self.pending.receive().map_err(|e| TransportError::new("receiving a response", &e))
    }
}

#[cfg(test)]
mod tests {
    use iceoryx2::service::ipc_threadsafe;

    use super::*;
    use crate::{Limits, RuntimeDir, Services, clean_if_abandoned};

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

    #[test]
    fn a_request_keeps_the_length_that_was_lent() {
        let path = std::env::temp_dir().join(format!("pairmask-own-{}", std::process::id()));
        let (dir, name) = (RuntimeDir::at(&path), "own".parse().expect("a name"));
        dir.ensure().expect("a directory of our own");
        let limits = Limits::default();
        let services =
            Services::<ipc_threadsafe::Service>::serve(&dir, &name, &limits).expect("served");
        let server = services.server(&limits).expect("a server");
        let client_side =
            Services::<ipc_threadsafe::Service>::connect(&dir, &name).expect("connected");
        let client = client_side.client(1, 2).expect("a client");

        let mut request = OwnRequest::lend(&client.port, 2).expect("two pages");
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

        drop((sent, client, client_side, server, services));
        clean_if_abandoned(&dir, &name).expect("no process is left");
        std::fs::remove_dir_all(path).expect("the directory of our own");
    }
}
