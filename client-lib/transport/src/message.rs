//! Messages of the other side: headers are copied once, payloads are checked against the sender's
//! segment.
//!
//! The transport makes a payload's slice from a length in the sender's memory, which it reads again at
//! each access. This module reads the length once, and checks it before it makes a slice.
#![allow(unsafe_code)]

use std::ptr;

use iceoryx2::service::header::payload_header::PayloadHeader;
use pairmask_wire::{PAGE_BYTES, Page, RequestHeader, ResponseHeader};

use crate::segment::Segment;
use crate::services::{ActiveRequest, ResponseSample};

/// Address of a payload by the transport's layout: the first page boundary behind the headers.
pub(super) fn payload_behind<H>(user_header: *const H) -> usize {
    (user_header as usize + size_of::<H>()).next_multiple_of(PAGE_BYTES)
}

/// Pages within a sender's segment.
#[derive(Clone, Copy, Debug)]
struct Payload {
    address: usize,
    pages: usize,
}

impl Payload {
    /// The payload behind a user header; empty where `pages` pages would not lie within the segment.
    fn behind<H>(user_header: *const H, pages: u64, segment: &Segment) -> Self {
        let address = payload_behind(user_header);
        let bytes = usize::try_from(pages).ok().and_then(|pages| pages.checked_mul(PAGE_BYTES));
        match bytes {
            Some(bytes) if segment.holds(address, bytes) => {
                Self { address, pages: bytes / PAGE_BYTES }
            }
            _ => Self { address, pages: 0 },
        }
    }

    /// The pages.
    ///
    /// # Safety
    /// The message that the payload belongs to is held during `'a`.
    unsafe fn pages<'a>(self) -> &'a [Page] {
        let first = ptr::with_exposed_provenance(self.address);
        // SAFETY: the pages lie within a shared mapping, as was checked, which stays as long as the
        // message is held; they are aligned, and any bytes are a valid Page.
        unsafe { std::slice::from_raw_parts(first, self.pages) }
    }
}

/// Copies the transport's header and the user header behind it, and checks the payload. `None` where the headers lie
/// outside of the segment.
fn copied<T: PayloadHeader + Copy, H: Copy>(
    (sent, user): (*const T, *const H),
    segment: &Segment,
) -> Option<(T, H, Payload)> {
    let (start, end) = (sent as usize, user as usize + size_of::<H>());
    end.checked_sub(start).filter(|bytes| segment.holds(start, *bytes))?;
    // SAFETY: both lie within a mapped segment, as was checked, and any bytes are valid headers.
    // The sender may write to them: volatile, so that they are read once and no more.
    let (sent, header) = unsafe { (sent.read_volatile(), user.read_volatile()) };
    let payload = Payload::behind(user, sent.number_of_elements(), segment);
    Some((sent, header, payload))
}

/// A request that was checked. Its header is a copy and its length is fixed, regardless of its sender
/// writes later.
#[derive(Debug)]
pub struct CheckedRequest {
    request: ActiveRequest,
    header: RequestHeader,
    payload: Payload,
}

/// A request that names another client than its sender. The transport would send its answer to that
/// client, and so would it the notice of a dropped request: hold the request as long as that client
/// may wait.
#[derive(Debug)]
pub struct ForgedRequest {
    /// The request.
    pub request: ActiveRequest,
}

impl CheckedRequest {
    /// Address of a request's headers, by which its segment is found.
    pub fn address(request: &ActiveRequest) -> usize {
        ptr::from_ref(request.header()) as usize
    }

    /// Checks a request against its sender's segment. A payload that leaves the segment counts as
    /// empty.
    ///
    /// # Errors
    /// [`ForgedRequest`] where the headers lie outside of the segment, or name another client than
    /// the sender.
    pub fn new(request: ActiveRequest, segment: &Segment) -> Result<Self, ForgedRequest> {
        let headers = (ptr::from_ref(request.header()), ptr::from_ref(request.user_header()));
        match copied(headers, segment) {
            Some((sent, header, payload)) if sent.client_id() == request.origin() => {
                Ok(Self { request, header, payload })
            }
            _ => Err(ForgedRequest { request }),
        }
    }

    /// The copied header.
    pub const fn header(&self) -> &RequestHeader {
        &self.header
    }

    /// The payload.
    pub fn pages(&self) -> &[Page] {
        // SAFETY: the request is held by `self`.
        unsafe { self.payload.pages() }
    }

    /// The request as one that later checks found to be forged.
    pub fn into_forged(self) -> ForgedRequest {
        ForgedRequest { request: self.request }
    }

    /// The request, to be answered.
    pub const fn request(&self) -> &ActiveRequest {
        &self.request
    }
}

/// As [`CheckedRequest`], for a daemon's response.
pub struct CheckedResponse {
    // Held for its memory; its header is not read again.
    _sample: ResponseSample,
    payload: Payload,
}

impl CheckedResponse {
    /// Address of a response's headers, by which its segment is found.
    pub fn address(sample: &ResponseSample) -> usize {
        ptr::from_ref(sample.header()) as usize
    }

    /// Checks a response against the daemon's segment, and copies its header. A payload that leaves the
    /// segment counts as empty. `None` where the headers lie outside of the segment.
    pub fn new(sample: ResponseSample, segment: &Segment) -> Option<(ResponseHeader, Self)> {
        let headers = (ptr::from_ref(sample.header()), ptr::from_ref(sample.user_header()));
        let (_, header, payload) = copied(headers, segment)?;
        Some((header, Self { _sample: sample, payload }))
    }

    /// The payload.
    pub fn pages(&self) -> &[Page] {
        // SAFETY: the sample is held by `self`.
        unsafe { self.payload.pages() }
    }
}
