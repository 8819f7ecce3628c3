/* Culls frames from the standard input: a count and so many boxes, until it ends. It answers with four numbers,
 * pairs, empty boxes, invalid ones and what served, and with the pairs. */
#include "check.h"

static void append(void *user, const pm_pair *pairs, size_t count) {
  pm_pair **end = user;
  memcpy(*end, pairs, count * sizeof *pairs);
  *end += count;
}

int main(int argc, char **argv) {
  const pm_session_options options = options_of(argc, argv);
  pm_session session;
  uint32_t n;
  EXPECT(PM_OK, pm_session_connect(&options, &session));
  while (fread(&n, sizeof n, 1, stdin) == 1) {
    pm_frame frame;
    pm_pending pending;
    pm_mask mask;
    pm_box *boxes;
    const pm_pair *pairs;
    pm_pair *copy, *end;
    size_t count;
    uint32_t head[4];
    pm_frame_info info = {SIZED(pm_frame_info)};

    EXPECT(PM_OK, pm_session_frame(session, n, &frame, &boxes));
    CHECK(fread(boxes, sizeof *boxes, n, stdin) == n);
    EXPECT(PM_OK, pm_frame_submit(frame, NULL, &pending));
    EXPECT(PM_OK, pm_pending_wait(pending, &mask));
    EXPECT(PM_OK, pm_mask_info(mask, &info));
    CHECK(info.n == n);

    copy = end = malloc((info.pair_count + 1) * sizeof *copy);
    CHECK(copy != NULL);
    EXPECT(PM_OK, pm_mask_for_each(mask, append, &end));
    EXPECT(PM_OK, pm_mask_pairs(mask, &pairs, &count));
    CHECK(count == info.pair_count && (size_t)(end - copy) == count);
    CHECK(count == 0 || memcmp(pairs, copy, count * sizeof *pairs) == 0);
    free(copy);

    head[0] = (uint32_t)count;
    head[1] = info.empty;
    head[2] = info.invalid;
    head[3] = info.served_by;
    CHECK(fwrite(head, sizeof head, 1, stdout) == 1);
    CHECK(fwrite(pairs, sizeof *pairs, count, stdout) == count);
    CHECK(fflush(stdout) == 0);
    EXPECT(PM_OK, pm_mask_drop(mask));
  }
  EXPECT(PM_OK, pm_session_drop(session));
  return 0;
}
