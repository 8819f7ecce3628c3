/* Pairmask: which of many boxes overlap. Broad-phase collision culling, exact and fast, in this process or by
 * a daemon through shared memory.
 *
 *     pm_session session;
 *     pm_frame frame;
 *     pm_pending pending;
 *     pm_mask mask;
 *     pm_box *boxes;
 *     const pm_pair *pairs;
 *     size_t count;
 *
 *     pm_session_connect(NULL, &session);
 *     pm_session_frame(session, 3, &frame, &boxes);     shared memory where a daemon serves
 *     ... write boxes[0] to boxes[2] ...
 *     pm_frame_submit(frame, NULL, &pending);
 *     pm_pending_wait(pending, &mask);
 *     pm_mask_pairs(mask, &pairs, &count);
 *     pm_mask_drop(mask);
 *     pm_session_drop(session);
 *
 * Codes. Nearly every function returns a pm_code: PM_OK, or why it did nothing. pm_last_error() says it in words.
 * Results are written through pointers, and only where PM_OK is returned.
 *
 * Handles are values: copy them, compare their ids, keep them. Zero is null. A handle of what was dropped is
 * told from one that lives: PM_ERR_HANDLE. Dropping zero is fine.
 *
 * Threads. A session, and what comes of it, belongs to one thread at a time; sessions are independent of each
 * other. A handle that two calls use at once is PM_ERR_BUSY for one of them. A frame may be awaited on another
 * thread than the one that sends it.
 *
 * Pointers. Where a pointer is given, it is null or aligned, and valid for as many values as are said beside it,
 * which nobody else writes during the call. It may be null where there are no values, where a text is left out, and
 * where a function says so. Pointers that are handed out live as long as the function says.
 *
 * Structs that may grow begin with struct_size: set it to sizeof, and all else to zero.
 *
 * Processes. A handle does not survive fork(): connect after it.
 *
 * This file is generated: see cbindgen.toml. Licence: MIT OR Apache-2.0. */
