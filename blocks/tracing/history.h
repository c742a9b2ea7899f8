/* Search in the history of a signal; the twin in Python is history.py, and events.h stores the points. A history
   consists of the number of points so far, the room for points, the size of the signal and the longest delay.
   The last points follow in a ring: time, number of the piece (the signal jumps between pieces), and values. */
#ifndef TF_HISTORY
#define TF_HISTORY 4
#define TF_NO_POINT 1e100 /* time of a missing point: its weight in an interpolation is zero */

typedef struct {
  const double* ring;
  long long first, kept, room, width; /* place of the oldest point; numbers of points; numbers in a point */
} tf_history;

static const double* tf_point(const tf_history* s, long long i) {
  i += s->first;
  return s->ring + (i < s->room ? i : i - s->room) * s->width;
}

/* The number of points whose time (column 0) or piece (column 1) is at most a value; both never decrease. */
static long long tf_until(const tf_history* s, int column, double value) {
  long long low = 0, high = s->kept;
  while (low < high) {
    long long middle = (low + high) / 2;
    if (tf_point(s, middle)[column] <= value)
      low = middle + 1;
    else
      high = middle;
  }
  return low;
}

static void tf_search(const double* h, double piece, double t, double* out) {
  const long long count = (long long)h[0], room = (long long)h[1];
  const tf_history s = {h + TF_HISTORY, count > room ? count % room : 0, count > room ? room : count, room,
                        2 + (long long)h[2]};
  const double* last = s.kept ? tf_point(&s, s.kept - 1) : 0;
  long long end = last && last[1] > piece ? tf_until(&s, 1, piece) : s.kept, k = tf_until(&s, 0, t);
  out[0] = end < s.kept ? tf_point(&s, end)[0] : INFINITY;
  out[1] = last ? last[0] : INFINITY;
  out[2] = k ? tf_point(&s, k - 1)[1] : 0.0;
  if (k > end - 1) k = end - 1;
  double *times = out + 3, *values = times + 4;
  for (int i = 0; i < 4; ++i) {
    long long place = k - 2 + i;
    const double* point = 0 <= place && place < end ? tf_point(&s, place) : 0;
    if (point && point[1] != piece) point = 0;
    times[i] = point ? point[0] : TF_NO_POINT * (i + 1);
    for (int e = 2; e < s.width; ++e) *values++ = point ? point[e] : 0.0;
  }
}
#endif
