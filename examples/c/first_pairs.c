/* Which of three boxes overlap. */
#include <pairmask.h>
#include <stdio.h>

/* Ends the program where a call has failed. */
static int failed(const char *what, pm_code code) {
  if (code != PM_OK) {
    fprintf(stderr, "%s: %s\n", what, pm_last_error());
  }
  return code != PM_OK;
}

int main(void) {
  pm_session session;
  pm_frame frame;
  pm_pending pending;
  pm_mask mask;
  pm_box *boxes;
  const pm_pair *pairs;
  pm_served_by served_by;
  size_t count, i;

  /* The daemon where one serves, else this process. */
  if (failed("connect", pm_session_connect(NULL, &session)) ||
      failed("served by", pm_session_served_by(session, &served_by)) ||
      /* Memory for three boxes. It is shared with the daemon where one serves. */
      failed("frame", pm_session_frame(session, 3, &frame, &boxes))) {
    return 1;
  }
  boxes[0] = (pm_box){{0, 0, 0}, {1, 1, 1}};
  boxes[1] = (pm_box){{0.5f, 0.5f, 0.5f}, {1.5f, 1.5f, 1.5f}};
  boxes[2] = (pm_box){{1, 0, 0}, {2, 1, 1}};

  if (failed("submit", pm_frame_submit(frame, NULL, &pending)) ||
      failed("wait", pm_pending_wait(pending, &mask)) ||
      failed("pairs", pm_mask_pairs(mask, &pairs, &count))) {
    return 1;
  }
  printf("served by %s\n", served_by == PM_SERVED_BY_DAEMON ? "a daemon" : "this process");
  for (i = 0; i < count; i++) {
    printf("boxes %u and %u overlap\n", pairs[i].a, pairs[i].b);
  }
  /* Boxes 0 and 2 only touch. That counts. */
  pm_mask_drop(mask);
  pm_session_drop(session);
  return count == 3 ? 0 : 1;
}
