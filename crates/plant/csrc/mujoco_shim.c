#include "mujoco_shim.h"

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef MISFIT_MUJOCO_LIBRARY
#define MISFIT_MUJOCO_LIBRARY ""
#endif

static _Thread_local char message[1024];

const char* misfit_mj_message(void) { return message; }
const char* misfit_mj_build_library(void) { return MISFIT_MUJOCO_LIBRARY; }

static void say(const char* text) {
  snprintf(message, sizeof message, "%s", text ? text : "no message");
}

#ifdef MISFIT_NO_MUJOCO

/* Without headers nothing can be opened, so nothing below can ever be handed a model. */
int misfit_mj_available(void) { return 0; }
int misfit_mj_header_version(void) { return 0; }
size_t misfit_mj_take_warnings(char* text, size_t capacity) {
  if (capacity) text[0] = 0;
  return 0;
}

static int refuse(void) {
  say("built without MuJoCo: install libmujoco-dev (Debian/Ubuntu: sudo apt-get install libmujoco-dev) "
      "or set MUJOCO_DIR, then build again");
  return -1;
}

#define UNUSED(x) ((void)(x))
int misfit_mj_open(const char* path, int* version) { UNUSED(path); *version = 0; return refuse(); }
int misfit_mj_load(const char* path, misfit_model** m) { UNUSED(path); *m = NULL; return refuse(); }
int misfit_mj_copy_model(const misfit_model* m, misfit_model** c) { UNUSED(m); *c = NULL; return refuse(); }
void misfit_mj_free_model(misfit_model* m) { UNUSED(m); }
int misfit_mj_make_data(const misfit_model* m, misfit_data** d) { UNUSED(m); *d = NULL; return refuse(); }
void misfit_mj_free_data(misfit_data* d) { UNUSED(d); }
int misfit_mj_size(const misfit_model* m, int which) { UNUSED(m); UNUSED(which); return 0; }
int misfit_mj_id(const misfit_model* m, int kind, const char* name) {
  UNUSED(m); UNUSED(kind); UNUSED(name);
  return -1;
}
void misfit_mj_joint(const misfit_model* m, int joint, int* type, int* qpos, int* dof) {
  UNUSED(m); UNUSED(joint);
  *type = *qpos = *dof = -1;
}
void misfit_mj_sensor(const misfit_model* m, int sensor, int* address, int* dimension) {
  UNUSED(m); UNUSED(sensor);
  *address = -1;
  *dimension = 0;
}
double misfit_mj_body_mass(const misfit_model* m, int body) { UNUSED(m); UNUSED(body); return 0; }
void misfit_mj_body_ipos(const misfit_model* m, int body, double ipos[3]) {
  UNUSED(m); UNUSED(body);
  ipos[0] = ipos[1] = ipos[2] = 0;
}
void misfit_mj_body_pos(const misfit_model* m, int body, double pos[3]) {
  UNUSED(m); UNUSED(body);
  pos[0] = pos[1] = pos[2] = 0;
}
int misfit_mj_body_parent(const misfit_model* m, int body) { UNUSED(m); UNUSED(body); return 0; }
double* misfit_mj_array(misfit_model* m, misfit_data* d, int which) {
  UNUSED(m); UNUSED(d); UNUSED(which);
  return NULL;
}
void misfit_mj_set_body_mass(misfit_model* m, int body, double mass) { UNUSED(m); UNUSED(body); UNUSED(mass); }
void misfit_mj_set_body_ipos(misfit_model* m, int body, const double ipos[3]) {
  UNUSED(m); UNUSED(body); UNUSED(ipos);
}
void misfit_mj_set_body_pos(misfit_model* m, int body, const double pos[3]) {
  UNUSED(m); UNUSED(body); UNUSED(pos);
}
int misfit_mj_position(const misfit_model* m, misfit_data* d) { UNUSED(m); UNUSED(d); return refuse(); }
int misfit_mj_static_residual(const misfit_model* m, misfit_data* d, double* out) {
  UNUSED(m); UNUSED(d); UNUSED(out);
  return refuse();
}
int misfit_mj_apply(const misfit_model* m, misfit_data* d, const double force[3], const double torque[3],
                    const double point[3], int body) {
  UNUSED(m); UNUSED(d); UNUSED(force); UNUSED(torque); UNUSED(point); UNUSED(body);
  return refuse();
}
int misfit_mj_jac_site(const misfit_model* m, misfit_data* d, double* translation, double* rotation, int site) {
  UNUSED(m); UNUSED(d); UNUSED(translation); UNUSED(rotation); UNUSED(site);
  return refuse();
}
int misfit_mj_sensors_at_rest(const misfit_model* m, misfit_data* d) { UNUSED(m); UNUSED(d); return refuse(); }
int misfit_mj_inverse(const misfit_model* m, misfit_data* d) { UNUSED(m); UNUSED(d); return refuse(); }
int misfit_mj_raise(int warning) { UNUSED(warning); return refuse(); }

#else

#include <dlfcn.h>
#include <mujoco/mujoco.h>

_Static_assert(sizeof(mjtNum) == sizeof(double), "misfit needs a MuJoCo built with double precision");

/* Every function used: typed by the header, found by name in the library. */
#define FUNCTIONS(X)                                                                                   \
  X(mj_version) X(mj_loadXML) X(mj_copyModel) X(mj_deleteModel) X(mj_makeData) X(mj_deleteData)        \
  X(mj_resetData) X(mj_name2id) X(mj_kinematics) X(mj_comPos) X(mj_rne) X(mj_passive) X(mj_applyFT)    \
  X(mj_jacSite) X(mj_rnePostConstraint) X(mj_sensorAcc) X(mj_inverse) X(mju_error) X(mju_warning)

static struct {
#define X(name) __typeof__(name)* name;
  FUNCTIONS(X)
#undef X
} mujoco;

/* MuJoCo must not return from its error handler, and by default ends the process. The trap brings the
 * thread back to the call that raised the error; frames left behind are MuJoCo's own C code only. */
static _Thread_local jmp_buf* trap;
static _Thread_local char warnings[4096];
static _Thread_local size_t warned;

static void on_error(const char* text) {
  say(text);
  if (trap) longjmp(*trap, 1);
  /* Every call that can raise is made under a trap; returning from here is not allowed. */
  fprintf(stderr, "MuJoCo: %s\n", message);
  abort();
}

/* By default a warning is appended to MUJOCO_LOG.TXT in the working directory. */
static void on_warning(const char* text) {
  size_t length = strlen(text);
  if (warned + length + 1 >= sizeof warnings) return;
  memcpy(warnings + warned, text, length);
  warned += length;
  warnings[warned++] = '\n';
}

/* Runs statements under a trap. */
#define TRAPPED(statements) TRAPPED_OR(, statements)

/* The same for a computation, which an error leaves with MuJoCo's stack half used: the data start anew. */
#define COMPUTED(model, data, statements) TRAPPED_OR(reset(model, data), statements)

#define TRAPPED_OR(recovery, statements) \
  do {                                   \
    jmp_buf here;                        \
    if (_setjmp(here)) {                 \
      trap = NULL;                       \
      recovery;                          \
      return -1;                         \
    }                                    \
    trap = &here;                        \
    statements;                          \
    trap = NULL;                         \
    return 0;                            \
  } while (0)

static int reset(const mjModel* model, mjData* data) { TRAPPED(mujoco.mj_resetData(model, data)); }

int misfit_mj_available(void) { return 1; }
int misfit_mj_header_version(void) { return mjVERSION_HEADER; }

size_t misfit_mj_take_warnings(char* text, size_t capacity) {
  size_t length = warned < capacity ? warned : capacity;
  memcpy(text, warnings, length);
  warned = 0;
  return length;
}

int misfit_mj_open(const char* path, int* version) {
  *version = 0;
  void* library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  if (!library) {
    say(dlerror());
    return -1;
  }
#define X(name)                                       \
  *(void**)(&mujoco.name) = dlsym(library, #name);    \
  if (!mujoco.name) {                                 \
    say(dlerror());                                   \
    dlclose(library);                                 \
    return -1;                                        \
  }
  FUNCTIONS(X)
#undef X
  *version = mujoco.mj_version();
  if (*version != mjVERSION_HEADER) {
    dlclose(library);
    return -2;
  }
  void (**error)(const char*) = (void (**)(const char*))dlsym(library, "mju_user_error");
  void (**warning)(const char*) = (void (**)(const char*))dlsym(library, "mju_user_warning");
  if (!error || !warning) {
    say("the library lacks mju_user_error or mju_user_warning");
    dlclose(library);
    return -1;
  }
  *error = on_error;
  *warning = on_warning;
  return 0;
}

int misfit_mj_load(const char* path, misfit_model** model) {
  char error[1000] = "";
  *model = NULL;
  TRAPPED({
    mjModel* m = mujoco.mj_loadXML(path, NULL, error, sizeof error);
    if (!m) {
      trap = NULL;
      say(error);
      return -1;
    }
    *model = m;
    /* What is left in a successful load's error text is a warning. */
    if (error[0]) on_warning(error);
  });
}

int misfit_mj_copy_model(const misfit_model* model, misfit_model** copy) {
  *copy = NULL;
  TRAPPED({
    *copy = mujoco.mj_copyModel(NULL, model);
    if (!*copy) {
      trap = NULL;
      say("no memory for a copy of the model");
      return -1;
    }
  });
}

void misfit_mj_free_model(misfit_model* model) { mujoco.mj_deleteModel(model); }

int misfit_mj_make_data(const misfit_model* model, misfit_data** data) {
  *data = NULL;
  TRAPPED({
    *data = mujoco.mj_makeData(model);
    if (!*data) {
      trap = NULL;
      say("no memory for the model's data");
      return -1;
    }
  });
}

void misfit_mj_free_data(misfit_data* data) { mujoco.mj_deleteData(data); }

int misfit_mj_size(const misfit_model* model, int which) {
  const mjModel* m = model;
  switch (which) {
    case MISFIT_NQ: return (int)m->nq;
    case MISFIT_NV: return (int)m->nv;
    case MISFIT_NBODY: return (int)m->nbody;
    case MISFIT_NJOINT: return (int)m->njnt;
    case MISFIT_NSITE: return (int)m->nsite;
    case MISFIT_NSENSOR: return (int)m->nsensor;
    case MISFIT_NSENSORDATA: return (int)m->nsensordata;
    default: return 0;
  }
}

int misfit_mj_id(const misfit_model* model, int kind, const char* name) {
  static const int types[] = {mjOBJ_BODY, mjOBJ_JOINT, mjOBJ_SITE, mjOBJ_SENSOR};
  return mujoco.mj_name2id(model, types[kind], name);
}

void misfit_mj_joint(const misfit_model* model, int joint, int* type, int* qpos, int* dof) {
  const mjModel* m = model;
  *type = m->jnt_type[joint];
  *qpos = m->jnt_qposadr[joint];
  *dof = m->jnt_dofadr[joint];
}

void misfit_mj_sensor(const misfit_model* model, int sensor, int* address, int* dimension) {
  const mjModel* m = model;
  *address = m->sensor_adr[sensor];
  *dimension = m->sensor_dim[sensor];
}

double misfit_mj_body_mass(const misfit_model* model, int body) {
  return ((const mjModel*)model)->body_mass[body];
}

void misfit_mj_body_ipos(const misfit_model* model, int body, double ipos[3]) {
  memcpy(ipos, ((const mjModel*)model)->body_ipos + 3 * body, 3 * sizeof *ipos);
}

void misfit_mj_body_pos(const misfit_model* model, int body, double pos[3]) {
  memcpy(pos, ((const mjModel*)model)->body_pos + 3 * body, 3 * sizeof *pos);
}

int misfit_mj_body_parent(const misfit_model* model, int body) {
  return ((const mjModel*)model)->body_parentid[body];
}

double* misfit_mj_array(misfit_model* model, misfit_data* data, int which) {
  mjModel* m = model;
  mjData* d = data;
  switch (which) {
    case MISFIT_QPOS: return d->qpos;
    case MISFIT_QPOS_SPRING: return m->qpos_spring;
    case MISFIT_QFRC_APPLIED: return d->qfrc_applied;
    case MISFIT_QFRC_INVERSE: return d->qfrc_inverse;
    case MISFIT_QFRC_PASSIVE: return d->qfrc_passive;
    case MISFIT_QFRC_BIAS: return d->qfrc_bias;
    case MISFIT_XFRC_APPLIED: return d->xfrc_applied;
    case MISFIT_XPOS: return d->xpos;
    case MISFIT_XQUAT: return d->xquat;
    case MISFIT_XIPOS: return d->xipos;
    case MISFIT_SITE_XPOS: return d->site_xpos;
    case MISFIT_SITE_XMAT: return d->site_xmat;
    case MISFIT_SENSORDATA: return d->sensordata;
    default: return NULL;
  }
}

/* mj_setConst would do this and much more (inertia at qpos0, inverse weights), none of which statics
 * reads. Subtree masses it does read: they divide the centre of mass that all spatial quantities refer
 * to. Any reference point is right in exact arithmetic, but a stale mass throws it far away from the
 * robot, and the digits with it. Summed from scratch, so that no history is left in the rounding. */
void misfit_mj_set_body_mass(misfit_model* model, int body, double mass) {
  mjModel* m = model;
  m->body_mass[body] = mass;
  int n = (int)m->nbody;
  memcpy(m->body_subtreemass, m->body_mass, (size_t)n * sizeof *m->body_mass);
  for (int i = n - 1; i > 0; i--) m->body_subtreemass[m->body_parentid[i]] += m->body_subtreemass[i];
}

void misfit_mj_set_body_ipos(misfit_model* model, int body, const double ipos[3]) {
  mjModel* m = model;
  memcpy(m->body_ipos + 3 * body, ipos, 3 * sizeof *ipos);
  /* Shortcuts taken when frames coincided at compile time. */
  m->body_sameframe[body] = 0;
  for (int i = 0; i < (int)m->nsite; i++) {
    if (m->site_bodyid[i] == body) m->site_sameframe[i] = 0;
  }
}

void misfit_mj_set_body_pos(misfit_model* model, int body, const double pos[3]) {
  memcpy(((mjModel*)model)->body_pos + 3 * body, pos, 3 * sizeof *pos);
}

int misfit_mj_position(const misfit_model* model, misfit_data* data) {
  COMPUTED(model, data, {
    mujoco.mj_kinematics(model, data);
    mujoco.mj_comPos(model, data);
  });
}

/* qvel is zero and stays so, hence the velocities that mj_rne reads (cvel, cdof_dot) are the zeros that
 * mj_makeData left: mj_comVel is not needed. */
int misfit_mj_static_residual(const misfit_model* model, misfit_data* data, double* out) {
  const mjModel* m = model;
  mjData* d = data;
  COMPUTED(model, data, {
    mujoco.mj_rne(m, d, 0, d->qfrc_bias);
    mujoco.mj_passive(m, d);
    for (int i = 0; i < (int)m->nv; i++) out[i] = d->qfrc_passive[i] - d->qfrc_bias[i] + d->qfrc_applied[i];
  });
}

int misfit_mj_apply(const misfit_model* model, misfit_data* data, const double force[3],
                    const double torque[3], const double point[3], int body) {
  COMPUTED(model, data, mujoco.mj_applyFT(model, data, force, torque, point, body, ((mjData*)data)->qfrc_applied));
}

int misfit_mj_jac_site(const misfit_model* model, misfit_data* data, double* translation,
                       double* rotation, int site) {
  COMPUTED(model, data, mujoco.mj_jacSite(model, data, translation, rotation, site));
}

int misfit_mj_sensors_at_rest(const misfit_model* model, misfit_data* data) {
  const mjModel* m = model;
  mjData* d = data;
  COMPUTED(model, data, {
    memset(d->qacc, 0, (size_t)m->nv * sizeof *d->qacc);
#if mjVERSION_HEADER >= 300
    /* Newer versions keep forces that were computed before; older ones compute them in mj_sensorAcc. */
    mujoco.mj_rnePostConstraint(m, d);
#endif
    mujoco.mj_sensorAcc(m, d);
  });
}

int misfit_mj_inverse(const misfit_model* model, misfit_data* data) {
  const mjModel* m = model;
  mjData* d = data;
  COMPUTED(model, data, {
    memset(d->qacc, 0, (size_t)m->nv * sizeof *d->qacc);
    mujoco.mj_inverse(m, d);
  });
}

int misfit_mj_raise(int warning) {
  TRAPPED({
    if (warning) {
      mujoco.mju_warning("raised for a test");
    } else {
      mujoco.mju_error("raised for a test");
    }
  });
}

#endif
