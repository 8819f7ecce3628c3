// The rows of queries: the pairs of each of them. Their counts are the last words of those that `scene_apply`
// zeroes in the control block.

// The word that counts the pairs of a query.
fn row_count_at(query: u32) -> u32 {
    return params.control_words - params.set_count + query;
}
