/* The few MuJoCo calls that misfit needs, as plain C functions with plain types.
 *
 * The shim is compiled against one MuJoCo's headers, because the layout of mjModel and mjData differs
 * between versions, and loads that MuJoCo's library at run time, because a user who only fits
 * measurements of a real robot needs no MuJoCo at all.
 *
 * Functions that return int give 0 when done and -1 when MuJoCo (or the shim) raised an error;
 * misfit_mj_message() then tells what was wrong. Indices are checked by the caller.
 */
#ifndef MISFIT_MUJOCO_SHIM_H
#define MISFIT_MUJOCO_SHIM_H

#include <stddef.h>

typedef void misfit_model;   /* an mjModel */
typedef void misfit_data;    /* an mjData */

/* Sizes of a model; the order is repeated in src/mujoco.rs. */
enum misfit_size {
  MISFIT_NQ, MISFIT_NV, MISFIT_NBODY, MISFIT_NJOINT, MISFIT_NSITE, MISFIT_NSENSOR, MISFIT_NSENSORDATA
};

/* Kinds of named things; the order is repeated in src/mujoco.rs. */
enum misfit_kind { MISFIT_BODY, MISFIT_JOINT, MISFIT_SITE, MISFIT_SENSOR };

/* Arrays of numbers of a model and its data; the order is repeated in src/mujoco.rs. */
enum misfit_array {
  MISFIT_QPOS,          /* nq */
  MISFIT_QPOS_SPRING,   /* nq */
  MISFIT_QFRC_APPLIED,  /* nv */
  MISFIT_QFRC_INVERSE,  /* nv */
  MISFIT_QFRC_PASSIVE,  /* nv */
  MISFIT_QFRC_BIAS,     /* nv */
  MISFIT_XFRC_APPLIED,  /* nbody x 6 */
  MISFIT_XPOS,          /* nbody x 3 */
  MISFIT_XQUAT,         /* nbody x 4 */
  MISFIT_XIPOS,         /* nbody x 3 */
  MISFIT_SITE_XPOS,     /* nsite x 3 */
  MISFIT_SITE_XMAT,     /* nsite x 9, by rows */
  MISFIT_SENSORDATA     /* nsensordata */
};

/* 1 if compiled against MuJoCo's headers. */
int misfit_mj_available(void);
/* mjVERSION_HEADER, 0 without headers. */
int misfit_mj_header_version(void);
/* Where the build found the library, "" if it did not. */
const char* misfit_mj_build_library(void);
/* What the last error on this thread was. */
const char* misfit_mj_message(void);
/* Copies what MuJoCo warned of on this thread since the last call, a line each; returns the length. */
size_t misfit_mj_take_warnings(char* text, size_t capacity);

/* Loads the library: to be called once, before anything below. The version is mj_version() of the
 * library, also when the call fails because it is not the headers'. 0 done, -1 cannot be loaded,
 * -2 of another version than the headers. */
int misfit_mj_open(const char* path, int* version);

int misfit_mj_load(const char* path, misfit_model** model);
int misfit_mj_copy_model(const misfit_model* model, misfit_model** copy);
void misfit_mj_free_model(misfit_model* model);
int misfit_mj_make_data(const misfit_model* model, misfit_data** data);
void misfit_mj_free_data(misfit_data* data);

int misfit_mj_size(const misfit_model* model, int which);
int misfit_mj_id(const misfit_model* model, int kind, const char* name);
/* Type: 0 free, 1 ball, 2 slide, 3 hinge. */
void misfit_mj_joint(const misfit_model* model, int joint, int* type, int* qpos, int* dof);
void misfit_mj_sensor(const misfit_model* model, int sensor, int* address, int* dimension);
double misfit_mj_body_mass(const misfit_model* model, int body);
void misfit_mj_body_ipos(const misfit_model* model, int body, double ipos[3]);
void misfit_mj_body_pos(const misfit_model* model, int body, double pos[3]);
int misfit_mj_body_parent(const misfit_model* model, int body);
double* misfit_mj_array(misfit_model* model, misfit_data* data, int which);

/* Also brings the masses of the subtrees up to date. */
void misfit_mj_set_body_mass(misfit_model* model, int body, double mass);
/* Also tells MuJoCo that the inertial frame is no longer the body's own. */
void misfit_mj_set_body_ipos(misfit_model* model, int body, const double ipos[3]);
/* Where a body sits in its parent. */
void misfit_mj_set_body_pos(misfit_model* model, int body, const double pos[3]);

/* Poses of all bodies and sites at qpos, and what Jacobians need. */
int misfit_mj_position(const misfit_model* model, misfit_data* data);
/* After misfit_mj_position: out (nv) = qfrc_passive - qfrc_bias + qfrc_applied at rest. */
int misfit_mj_static_residual(const misfit_model* model, misfit_data* data, double* out);
/* After misfit_mj_position: adds a force and torque at a point (world frame) of a body to qfrc_applied. */
int misfit_mj_apply(const misfit_model* model, misfit_data* data, const double force[3],
                    const double torque[3], const double point[3], int body);
/* After misfit_mj_position: 3 x nv each, by rows. */
int misfit_mj_jac_site(const misfit_model* model, misfit_data* data, double* translation,
                       double* rotation, int site);
/* After misfit_mj_position: force and torque sensors of a robot at rest (uses xfrc_applied). */
int misfit_mj_sensors_at_rest(const misfit_model* model, misfit_data* data);
/* The whole inverse dynamics at rest, to qfrc_inverse. */
int misfit_mj_inverse(const misfit_model* model, misfit_data* data);

/* For tests of the trap: has MuJoCo raise an error (0) or a warning (1) of its own accord. */
int misfit_mj_raise(int warning);

#endif
