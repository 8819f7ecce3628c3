//! Fresh loans of the transport as initialised pages.
#![allow(unsafe_code)]

use crate::services::{RequestLoan, ResponseLoan, UninitRequest, UninitResponse};

/// A fresh loan for a request, as pages of unspecified contents.
pub fn assume_pages(loan: UninitRequest) -> RequestLoan {
    // SAFETY: a loan is part of a shared mapping, whose bytes always hold some value (zero or
    // what an earlier frame left), and every value is a valid Page.
    unsafe { loan.assume_init() }
}

/// As [`assume_pages`], for a response.
pub fn assume_response_pages(loan: UninitResponse) -> ResponseLoan {
    // SAFETY: as in `assume_pages`.
    unsafe { loan.assume_init() }
}
