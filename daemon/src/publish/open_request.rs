//! Shared memory for a mask, lent when its size is known.

use pairmask::engine::{ReplyBuffer, ReserveError};
use pairmask::transport::{
    ActiveRequest, Populated, ResponseLoan, TransportError, assume_response_pages, words_in,
};
use pairmask::wire::{ResponseHeader, page_count};

use super::{copy_bytes, response_words};

/// Bytes of a word of a mask.
const WORD_BYTES: u64 = size_of::<u32>() as u64;

/// The memory of one response.
pub(super) struct LoanReply<'a> {
    request: &'a ActiveRequest,
    populated: &'a mut Populated,
    limit_bytes: u64,
    loan: Option<ResponseLoan>,
}

impl<'a> LoanReply<'a> {
    pub(super) const fn new(
        request: &'a ActiveRequest,
        populated: &'a mut Populated,
        limit_bytes: u64,
    ) -> Self {
        Self { request, populated, limit_bytes, loan: None }
    }

    /// The loan as it is, to go on with later ([`Self::with_loan`]).
    pub(super) fn into_loan(self) -> Option<ResponseLoan> {
        self.loan
    }

    /// Goes on with a loan.
    pub(super) fn with_loan(self, loan: Option<ResponseLoan>) -> Self {
        Self { loan, ..self }
    }

    /// Puts a few bytes that are not a mask.
    pub(super) fn put(&mut self, bytes: &[u8]) -> Result<(), ReserveError> {
        let words = self.reserve(bytes.len().div_ceil(4) as u64)?;
        copy_bytes(words, bytes);
        Ok(())
    }

    /// What was written; nothing before memory was reserved.
    pub(super) fn words(&self) -> &[u32] {
        self.loan.as_ref().map_or(&[], |loan| words_in(loan.payload()))
    }

    /// What was written, to be changed.
    pub(super) fn words_mut(&mut self) -> &mut [u32] {
        self.loan.as_mut().map_or(&mut [], response_words)
    }

    /// Sends what was written. Where nothing was, one page goes with the header: the transport has
    /// no empty payload.
    pub(super) fn send(mut self, header: &ResponseHeader) -> Result<(), TransportError> {
        if self.loan.is_none() {
            self.reserve(0).map_err(|e| TransportError::new("lending a response", &e))?;
        }
        let Some(mut loan) = self.loan else { return Ok(()) };
        *loan.user_header_mut() = *header;
        loan.send().map_err(|e| TransportError::new("sending a response", &e))
    }
}

impl ReplyBuffer for LoanReply<'_> {
    fn limit_words(&self) -> u64 {
        self.limit_bytes / WORD_BYTES
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let needed_bytes = words.saturating_mul(WORD_BYTES);
        if needed_bytes > self.limit_bytes {
            let limit_bytes = self.limit_bytes;
            return Err(ReserveError::TooLarge { at_least_bytes: needed_bytes, limit_bytes });
        }
        let out_of_memory = ReserveError::OutOfMemory { needed_bytes };
        // A request has one loan at a time: the old one goes back first.
        self.loan = None;
        let pages = usize::try_from(page_count(needed_bytes)).map_err(|_| out_of_memory)?;
        let loan = self.request.loan_slice_uninit(pages).map_err(|_| out_of_memory)?;
        let mut loan = assume_response_pages(loan);
        self.populated.ensure(loan.payload_mut()).map_err(|_| out_of_memory)?;
        Ok(response_words(self.loan.insert(loan)))
    }
}
