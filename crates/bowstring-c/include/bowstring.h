// C interface of Bowstring: statics and inverse kinematics of tendon-driven continuum robots in a
// control loop. Guide: docs/guide/cpp.md.
//
// Units are SI: m, N, N m, rad, kg, s. Frames: the base frame is at the clamped end, z along the
// straight backbone. The tip frame is that of the last disk; a rotation has nine numbers, row by
// row, and maps tip axes to base axes. Tendons are numbered as in the robot file, segment by
// segment, inner first; an array of tendons has one number for each of them.
//
// Robot: `bowstring export ROBOT --out robot.json` writes the file that this library reads.
//
// Statuses: 0 is success, a positive one a result without success, a negative one a wrong call. The
// text of `bowstring_last_error` says what is wrong. Where there is no result, numbers are NaN. The
// arrays and structures of one call must not overlap.
//
// Threads: a robot may be used by any number of threads at once. A solver, and what is asked of it,
// must be used by one thread at a time; it may move to another thread. Solvers of the same robot do
// not share anything and run in parallel. No function starts a thread.

#pragma once

// Made from crates/bowstring-c by cbindgen; change it there, then: BOWSTRING_HEADER=write cargo test --release -p bowstring-c --test header

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// How a call ended: 0 for success, positive for a result without success, negative for a wrong
// call.
enum BowstringStatus
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Success. A forward solve has converged to an equilibrium that is not known to be unstable
  // (see `stable`); an inverse has reached its target within 1e-6 of the robot's length.
  BOWSTRING_STATUS_OK = 0,
  // Inverse: limits or robot do not allow the target. The tensions are those of a nearest tip.
  BOWSTRING_STATUS_UNREACHABLE = 1,
  // Forward: no convergence, no result. Inverse: a nearer tip may exist; the tensions are those
  // of the nearest that was found.
  BOWSTRING_STATUS_MAX_ITERATIONS = 2,
  // Forward: there is an equilibrium, but no stable one; no result.
  BOWSTRING_STATUS_UNSTABLE = 3,
  // The load has no equilibrium, or only one in which disks collide; no result.
  BOWSTRING_STATUS_NO_EQUILIBRIUM = 4,
  // The equilibrium has no finite derivatives, or the tendons touch the body everywhere; no
  // result.
  BOWSTRING_STATUS_NO_DERIVATIVES = 5,
  // Inverse: the tensions have several equilibria, and the one that follows from the last
  // solution is another than that whose tip is at the target.
  BOWSTRING_STATUS_OTHER_EQUILIBRIUM = 6,
  // An argument is wrong, or a query has no solution to ask about. Nothing was solved.
  BOWSTRING_STATUS_BAD_INPUT = -1,
  // An error in the library. Free the solver and make another.
  BOWSTRING_STATUS_INTERNAL = -2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum BowstringStatus BowstringStatus;
#else
typedef int32_t BowstringStatus;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// A robot; immutable.
typedef struct BowstringRobot BowstringRobot;

// A robot with its physics, limits of tension, last solution and scratch memory.
typedef struct BowstringSolver BowstringSolver;

// Settings of a solver; start from `bowstring_options_default`.
typedef struct BowstringOptions {
  // Backbone with shear and extension (0, Cosserat) or without (1, Kirchhoff).
  int32_t theory;
  // Fourth-order elements between two disks: 1, 2, 4 or 8; 0 chooses the fewest whose estimated
  // error of the tip is within 1e-5 of the length.
  int32_t elements;
  // Inverse, target out of reach: how much farther from it than the nearest tip the tip may be
  // for smaller tensions, over the length. 0: the nearest tip.
  double distance_margin;
} BowstringOptions;

// Dead loads in the base frame.
typedef struct BowstringLoad {
  // Gravity in m/s^2.
  double gravity_m_per_s2[3];
  // Force on the tip in N.
  double tip_force_N[3];
  // Moment on the tip in N m.
  double tip_moment_Nm[3];
} BowstringLoad;

// An equilibrium. Without one its numbers are NaN, but for `residual` and `iterations`.
typedef struct BowstringSolution {
  // Position of the tip in the base frame, m.
  double position_m[3];
  // Rotation of the tip, row by row; it maps tip axes to base axes.
  double rotation[9];
  // Largest moment imbalance over (bending stiffness / length); a solution is below 1e-10.
  double residual;
  // Estimated discretisation error of the tip in m.
  double error_estimate_m;
  // Newton steps.
  int32_t iterations;
  // Elements between two disks.
  int32_t elements;
  // 1: stable; 0: unstable, which a moment on the tip can lead to; -1: unknown.
  int32_t stable;
} BowstringSolution;

// Result of an inverse.
typedef struct BowstringInverse {
  // Equilibrium under the tensions, by a forward solve.
  struct BowstringSolution solution;
  // Distance from the tip of `solution` to the target in m.
  double distance_m;
  // Distance from the nearest tip that was found to the target in m: smaller where the margin
  // was used.
  double nearest_distance_m;
  // Angle between the tangent at the tip and the direction in rad; NaN without a direction.
  double direction_error_rad;
  // Iterations of all starts.
  int32_t iterations;
  // 1 where the target was not found from the last one but from another start, so that the robot
  // may jump to another shape. Otherwise 0.
  int32_t restarted;
} BowstringInverse;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Sentence about the last call of this thread that did not end with `BOWSTRING_STATUS_OK`, or
// returned `NULL`: UTF-8, never `NULL`. It is valid until the next such call of the same thread.
const char *bowstring_last_error(void);

// Version of the library, such as "0.1.0". It is valid for ever.
const char *bowstring_version(void);

// Reads a robot from the text of a file of `bowstring export`.
//
// `text` is UTF-8 of `size` bytes; it need not end with a zero. Returns `NULL` where it is no such
// text, or where the numbers are not those of a robot. Free the robot with `bowstring_robot_free`.
//
// # Safety
// `text` must point to `size` readable bytes.
struct BowstringRobot *bowstring_robot_from_text(const char *text, size_t size);

// Reads a robot from a file of `bowstring export`.
//
// `path` is UTF-8 and ends with a zero. Returns `NULL` where the file cannot be read, otherwise as
// `bowstring_robot_from_text`.
//
// # Safety
// `path` must point to a text that ends with a zero.
struct BowstringRobot *bowstring_robot_from_file(const char *path);

// Frees a robot; `NULL` is allowed. Its solvers stay valid.
//
// # Safety
// `robot` must be `NULL`, or come from this library and not have been freed.
void bowstring_robot_free(struct BowstringRobot *robot);

// Number of tendons; 0 for `NULL`.
//
// # Safety
// `robot` must be `NULL` or a robot of this library.
size_t bowstring_robot_tendon_count(const struct BowstringRobot *robot);

// Length of the straight backbone in m; NaN for `NULL`.
//
// # Safety
// `robot` must be `NULL` or a robot of this library.
double bowstring_robot_length(const struct BowstringRobot *robot);

// Options that a solver has by default: Cosserat, chosen elements, margin 1e-3.
struct BowstringOptions bowstring_options_default(void);

// Makes a solver; `options` may be `NULL` for the default.
//
// Returns `NULL` where an option is wrong. The limits of tension are 0 N and, as in the Python
// package, what bends the segment of the tendon by half a turn by the linear law; see
// `bowstring_set_limits`. Free the solver with `bowstring_solver_free`. It keeps what it needs of
// the robot, which may be freed before it.
//
// # Safety
// `robot` must be `NULL` or a robot of this library, `options` `NULL` or readable.
struct BowstringSolver *bowstring_solver_new(const struct BowstringRobot *robot,
                                             const struct BowstringOptions *options);

// Frees a solver; `NULL` is allowed.
//
// # Safety
// `solver` must be `NULL`, or come from this library and not have been freed.
void bowstring_solver_free(struct BowstringSolver *solver);

// Sets the limits of tension of the inverse in N, `tendon_count` numbers each. `NULL` keeps the
// present ones.
//
// # Safety
// The arrays must be `NULL` or have `tendon_count` numbers.
BowstringStatus bowstring_set_limits(struct BowstringSolver *solver,
                                     const double *min_tensions,
                                     const double *max_tensions,
                                     size_t tendon_count);

// Forgets the last solution: the next solve starts from the straight robot, the next inverse from
// starts of its own.
//
// # Safety
// `solver` must be `NULL` or a solver of this library that no other thread uses.
BowstringStatus bowstring_reset(struct BowstringSolver *solver);

// Solves the equilibrium under tensions and dead loads, from the last solution if there is one.
//
// `tensions` has `tendon_count` numbers in N, none negative. `load` may be `NULL`: the gravity of
// the robot file and no wrench. `solution` may be `NULL`.
//
// A solve from the last solution takes few Newton steps and no memory from the heap, unless more
// elements become necessary than before: fix `elements`, or call it once with the largest load
// before the loop.
//
// # Safety
// Pointers must be `NULL` or point to what is said here.
BowstringStatus bowstring_solve(struct BowstringSolver *solver,
                                const double *tensions,
                                size_t tendon_count,
                                const struct BowstringLoad *load,
                                struct BowstringSolution *solution);

// Finds tensions within the limits that bring the tip to a position, from the last target if there
// is one: for targets along a path.
//
// `position` has three numbers in m, base frame. `direction` has three numbers, the wanted tangent
// at the tip (its length does not matter), or is `NULL`. `load` may be `NULL` as for
// `bowstring_solve`. `tensions`, of `tendon_count` numbers, takes the result in N; where several
// lead to the target, the least sum of squares near the last ones. With the statuses
// `UNREACHABLE` and `MAX_ITERATIONS` they lead to a nearest tip; without an equilibrium, and after
// a wrong call, they are NaN. `result` may be `NULL`.
//
// Where a robot has more tendons than the target needs, the least tensions can change from one set
// to another between neighbouring targets, also without `restarted`: limit the rate of the commands
// where a motor must not jump. The inverse takes memory from the heap in each call, and a target
// that is not found from the last one takes many times as long.
//
// # Safety
// Pointers must be `NULL` or point to what is said here.
BowstringStatus bowstring_inverse(struct BowstringSolver *solver,
                                  const double *position,
                                  const double *direction,
                                  const struct BowstringLoad *load,
                                  double *tensions,
                                  size_t tendon_count,
                                  struct BowstringInverse *result);

// Lengths of the tendons in the last solution, from the base hole to the hole of the end disk, in
// m: `tendon_count` numbers. NaN, and `BOWSTRING_STATUS_BAD_INPUT`, without one.
//
// # Safety
// `lengths` must be `NULL` or have room for `tendon_count` numbers.
BowstringStatus bowstring_tendon_lengths(struct BowstringSolver *solver,
                                         double *lengths,
                                         size_t tendon_count);

// Tendon displacements of the last solution in m, counted from the home pose and positive where
// the tendon is shortened: `tendon_count` numbers. They include the compliance of the tendons.
//
// The home pose is that under the pretensions of the robot file without gravity. Without one the
// status is `BOWSTRING_STATUS_NO_EQUILIBRIUM`.
//
// # Safety
// `displacements` must be `NULL` or have room for `tendon_count` numbers.
BowstringStatus bowstring_displacements(struct BowstringSolver *solver,
                                        double *displacements,
                                        size_t tendon_count);

// Derivatives of the tip by each tension in the last solution: 6 `tendon_count` numbers, row by
// row. Rows 0 to 2: position along x, y, z in m/N; rows 3 to 5: rotation vector in the base frame
// in rad/N. Takes memory from the heap.
//
// # Safety
// `derivatives` must be `NULL` or have room for 6 `tendon_count` numbers.
BowstringStatus bowstring_tip_derivatives(struct BowstringSolver *solver,
                                          double *derivatives,
                                          size_t tendon_count);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus
