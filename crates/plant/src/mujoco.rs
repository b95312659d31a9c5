//! MuJoCo, as far as statics needs it: models, poses, joint torques at rest, force sensors.
//!
//! The only module that speaks to MuJoCo and the only one with `unsafe`. The calls go through the C shim
//! in `csrc/`, which loads MuJoCo's library when the first model is made: a program that makes none needs
//! no MuJoCo. `MUJOCO_DIR` names another MuJoCo than the system's; it must be the version that the shim
//! was compiled against. MuJoCo's errors, which by default end the process, come back as [`MujocoError`].
//!
//! All quantities are in SI units; quaternions and rotations give `world_from_…`; velocities are zero.

#![allow(unsafe_code)] // calls into C; every index and length is checked on this side first

mod library;

use nalgebra::{Isometry3, Matrix3, Matrix3xX, Quaternion, Translation3, UnitQuaternion, Vector3};
use std::ffi::{CStr, CString, c_char, c_double, c_int, c_void};
use std::io::Write;
use std::path::Path;
use std::ptr::{NonNull, null_mut};
use std::sync::{Mutex, PoisonError};

/// What kept MuJoCo from doing what it was asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MujocoError {
    /// No library, or a program built without the headers.
    #[error("MuJoCo cannot be used: {0}")]
    Unavailable(String),
    /// The layout of MuJoCo's structures differs between versions, so both must be the same.
    #[error(
        "{library} is MuJoCo {found}, but this program was built for MuJoCo {built}: set MUJOCO_DIR to a \
         MuJoCo {built}, or build again with MUJOCO_DIR set to the other"
    )]
    Version {
        /// Which library was loaded.
        library: String,
        /// Its version.
        found: String,
        /// The version of the headers.
        built: String,
    },
    /// The model's text is not one MuJoCo accepts.
    #[error("MuJoCo does not accept the model: {0}")]
    Model(String),
    /// An error raised while computing; the data were reset.
    #[error("MuJoCo: {0}")]
    Computation(String),
    /// A name the model does not hold.
    #[error("the MuJoCo model has no {kind} named `{name}`")]
    Name {
        /// body, joint, site or sensor.
        kind: &'static str,
        /// What was asked for.
        name: String,
    },
    /// An index beyond the end.
    #[error("{what} {index} does not exist: the MuJoCo model has {count}")]
    Index {
        /// What was counted.
        what: &'static str,
        /// What was asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A mass, position or length of slice that makes no sense.
    #[error("{0}")]
    Value(String),
}

/// What can be found by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A rigid body.
    Body,
    /// A joint.
    Joint,
    /// A site: a frame fixed to a body.
    Site,
    /// A sensor.
    Sensor,
}

impl Kind {
    fn word(self) -> &'static str {
        match self {
            Kind::Body => "body",
            Kind::Joint => "joint",
            Kind::Site => "site",
            Kind::Sensor => "sensor",
        }
    }
}

/// Where a joint's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JointAddress {
    /// Index of its (first) coordinate in `qpos`.
    pub qpos: usize,
    /// Index of its (first) degree of freedom in torques and Jacobians.
    pub dof: usize,
    /// Whether it has one coordinate (a hinge or a slide) and not a free or ball joint's.
    pub scalar: bool,
}

/// A compiled model.
#[derive(Debug)]
pub struct Model {
    pointer: NonNull<c_void>,
}

// SAFETY: a model is plain memory: nothing in it belongs to a thread, and what takes `&self` only reads.
unsafe impl Send for Model {}
// SAFETY: as above.
unsafe impl Sync for Model {}

impl Model {
    /// Compiles a model from the text of an MJCF or URDF file.
    ///
    /// # Errors
    /// If MuJoCo is not there, or does not accept the text.
    pub fn from_xml_string(text: &str) -> Result<Model, MujocoError> {
        // Reading from memory is done differently by each generation of MuJoCo; files all read alike.
        let unwritten =
            |error| MujocoError::Unavailable(format!("cannot write a temporary file: {error}"));
        let mut file = tempfile::Builder::new()
            .prefix("misfit")
            .suffix(".xml")
            .tempfile()
            .map_err(unwritten)?;
        file.write_all(text.as_bytes()).map_err(unwritten)?;
        Model::from_xml_file(file.path())
    }

    /// Compiles a model from an MJCF or URDF file.
    ///
    /// From a URDF MuJoCo drops the frames of links that cannot move, unless the file's `<mujoco>`
    /// element says `fusestatic="false"`.
    ///
    /// # Errors
    /// If MuJoCo is not there, or does not accept the file.
    pub fn from_xml_file(path: &Path) -> Result<Model, MujocoError> {
        // MuJoCo's parser shares the process's locale and its last model between threads.
        static LOADING: Mutex<()> = Mutex::new(());
        library::open()?;
        let c_path = CString::new(path.as_os_str().as_encoded_bytes()).map_err(|_| {
            MujocoError::Model(format!("{}: a path with a zero byte", path.display()))
        })?;
        let _alone = LOADING.lock().unwrap_or_else(PoisonError::into_inner);
        let mut pointer = null_mut();
        // SAFETY: the path ends in a zero byte and outlives the call; the pointer is ours to be written.
        let status = unsafe { misfit_mj_load(c_path.as_ptr(), &raw mut pointer) };
        match NonNull::new(pointer) {
            Some(pointer) if status == 0 => Ok(Model { pointer }),
            _ => Err(MujocoError::Model(message())),
        }
    }

    /// A copy with its own masses and springs.
    ///
    /// # Errors
    /// If memory is short.
    pub fn try_clone(&self) -> Result<Model, MujocoError> {
        let mut pointer = null_mut();
        // SAFETY: the model is alive; the pointer is ours to be written.
        let status = unsafe { misfit_mj_copy_model(self.as_ptr(), &raw mut pointer) };
        match NonNull::new(pointer) {
            Some(pointer) if status == 0 => Ok(Model { pointer }),
            _ => Err(MujocoError::Computation(message())),
        }
    }

    /// Number of coordinates in `qpos`.
    pub fn coordinates(&self) -> usize {
        self.size(Size::Nq)
    }

    /// Number of degrees of freedom.
    pub fn dofs(&self) -> usize {
        self.size(Size::Nv)
    }

    /// Number of bodies with the world, which is body 0.
    pub fn bodies(&self) -> usize {
        self.size(Size::Nbody)
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.size(Size::Njoint)
    }

    /// Number of sites.
    pub fn sites(&self) -> usize {
        self.size(Size::Nsite)
    }

    /// Number of sensors.
    pub fn sensors(&self) -> usize {
        self.size(Size::Nsensor)
    }

    /// Index of what has this name.
    ///
    /// # Errors
    /// If nothing of that kind has it.
    pub fn find(&self, kind: Kind, name: &str) -> Result<usize, MujocoError> {
        let missing = || MujocoError::Name {
            kind: kind.word(),
            name: name.to_owned(),
        };
        let c_name = CString::new(name).map_err(|_| missing())?;
        // SAFETY: the model is alive; the name ends in a zero byte and outlives the call.
        let id = unsafe { misfit_mj_id(self.as_ptr(), kind as c_int, c_name.as_ptr()) };
        usize::try_from(id).map_err(|_| missing())
    }

    /// Where the joint's numbers are.
    ///
    /// # Errors
    /// If there is no such joint.
    pub fn joint(&self, joint: usize) -> Result<JointAddress, MujocoError> {
        let joint = checked("joint", joint, self.joints())?;
        let (mut kind, mut qpos, mut dof) = (0, 0, 0);
        // SAFETY: the model is alive, the index is checked, and all three numbers are ours to be written.
        unsafe {
            misfit_mj_joint(
                self.as_ptr(),
                joint,
                &raw mut kind,
                &raw mut qpos,
                &raw mut dof,
            )
        };
        Ok(JointAddress {
            qpos: qpos.max(0) as usize,
            dof: dof.max(0) as usize,
            scalar: kind >= 2,
        })
    }

    /// Mass of a body, kg.
    ///
    /// # Errors
    /// If there is no such body.
    pub fn body_mass(&self, body: usize) -> Result<f64, MujocoError> {
        let body = checked("body", body, self.bodies())?;
        // SAFETY: the model is alive and the index is checked.
        Ok(unsafe { misfit_mj_body_mass(self.as_ptr(), body) })
    }

    /// Centre of mass in the body's frame, m.
    ///
    /// # Errors
    /// If there is no such body.
    pub fn body_ipos(&self, body: usize) -> Result<Vector3<f64>, MujocoError> {
        let body = checked("body", body, self.bodies())?;
        let mut ipos = [0.0; 3];
        // SAFETY: the model is alive, the index is checked; three numbers are read or written, which the array has.
        unsafe { misfit_mj_body_ipos(self.as_ptr(), body, ipos.as_mut_ptr()) };
        Ok(Vector3::from(ipos))
    }

    /// Where a body sits in its parent at rest, m.
    ///
    /// # Errors
    /// If there is no such body.
    pub fn body_pos(&self, body: usize) -> Result<Vector3<f64>, MujocoError> {
        let body = checked("body", body, self.bodies())?;
        let mut pos = [0.0; 3];
        // SAFETY: the model is alive, the index is checked; three numbers are read or written, which the array has.
        unsafe { misfit_mj_body_pos(self.as_ptr(), body, pos.as_mut_ptr()) };
        Ok(Vector3::from(pos))
    }

    /// The body that a body is fixed to or hangs on; the world's is the world.
    ///
    /// # Errors
    /// If there is no such body.
    pub fn body_parent(&self, body: usize) -> Result<usize, MujocoError> {
        let body = checked("body", body, self.bodies())?;
        // SAFETY: the model is alive and the index is checked.
        Ok(unsafe { misfit_mj_body_parent(self.as_ptr(), body) }.max(0) as usize)
    }

    fn size(&self, which: Size) -> usize {
        // SAFETY: the model is alive, and `Size` lists the sizes that the shim knows.
        unsafe { misfit_mj_size(self.as_ptr(), which as c_int) }.max(0) as usize
    }

    fn as_ptr(&self) -> *mut c_void {
        self.pointer.as_ptr()
    }
}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: the pointer came from the shim, is freed once, and nothing uses it after.
        unsafe { misfit_mj_free_model(self.as_ptr()) }
    }
}

/// A model with the state it is in. Velocities and accelerations are zero and stay so.
///
/// It owns its model, because MuJoCo's data are laid out for one model and fit no other.
#[derive(Debug)]
pub struct Data {
    pointer: NonNull<c_void>,
    model: Model,
}

// SAFETY: as for the model; the shim's traps and messages are the calling thread's own.
unsafe impl Send for Data {}
// SAFETY: as above.
unsafe impl Sync for Data {}

impl Data {
    /// The model at its reference position.
    ///
    /// # Errors
    /// If memory is short.
    pub fn new(model: Model) -> Result<Data, MujocoError> {
        let mut pointer = null_mut();
        // SAFETY: the model is alive and owned beside the data from here on; the pointer is ours to be written.
        let status = unsafe { misfit_mj_make_data(model.as_ptr(), &raw mut pointer) };
        match NonNull::new(pointer) {
            Some(pointer) if status == 0 => Ok(Data { pointer, model }),
            _ => Err(MujocoError::Computation(message())),
        }
    }

    /// A copy of the model, masses and springs as they are now, at its reference position.
    ///
    /// # Errors
    /// If memory is short.
    pub fn fork(&self) -> Result<Data, MujocoError> {
        Data::new(self.model.try_clone()?)
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Coordinates: rad for hinges, m for slides.
    pub fn qpos(&self) -> &[f64] {
        self.array(Array::Qpos, self.model.coordinates())
    }

    /// The same, to be set; poses follow with [`Data::update_position`].
    pub fn qpos_mut(&mut self) -> &mut [f64] {
        self.array_mut(Array::Qpos, self.model.coordinates())
    }

    /// Where the springs of the joints are at rest.
    pub fn qpos_spring(&self) -> &[f64] {
        self.array(Array::QposSpring, self.model.coordinates())
    }

    /// The same, to be set.
    pub fn qpos_spring_mut(&mut self) -> &mut [f64] {
        self.array_mut(Array::QposSpring, self.model.coordinates())
    }

    /// Torques added to the joints' own by [`Data::apply_force`], N·m (N).
    pub fn qfrc_applied(&self) -> &[f64] {
        self.array(Array::QfrcApplied, self.model.dofs())
    }

    /// The same, to be set or cleared.
    pub fn qfrc_applied_mut(&mut self) -> &mut [f64] {
        self.array_mut(Array::QfrcApplied, self.model.dofs())
    }

    /// Torques of the springs, as the last [`Data::static_residual`] found them, N·m (N).
    pub fn qfrc_passive(&self) -> &[f64] {
        self.array(Array::QfrcPassive, self.model.dofs())
    }

    /// Torques that would hold the robot against gravity, as the last [`Data::static_residual`] found
    /// them, N·m (N).
    pub fn qfrc_bias(&self) -> &[f64] {
        self.array(Array::QfrcBias, self.model.dofs())
    }

    /// Sets a body's mass, kg; zero is allowed.
    ///
    /// # Errors
    /// If there is no such body, or the mass is negative or not finite.
    pub fn set_body_mass(&mut self, body: usize, mass: f64) -> Result<(), MujocoError> {
        let body = checked("body", body, self.model.bodies())?;
        if !(mass >= 0.0 && mass.is_finite()) {
            return Err(MujocoError::Value(format!("a mass of {mass} kg")));
        }
        // SAFETY: the model is alive, the index is checked, and the numbers are finite.
        unsafe { misfit_mj_set_body_mass(self.model.as_ptr(), body, mass) };
        Ok(())
    }

    /// Sets a body's centre of mass in its own frame, m.
    ///
    /// # Errors
    /// If there is no such body, or the position is not finite.
    pub fn set_body_ipos(&mut self, body: usize, ipos: Vector3<f64>) -> Result<(), MujocoError> {
        let body = checked("body", body, self.model.bodies())?;
        finite(&ipos, "a centre of mass")?;
        // SAFETY: the model is alive, the index is checked, and the numbers are finite.
        unsafe { misfit_mj_set_body_ipos(self.model.as_ptr(), body, ipos.as_ptr()) };
        Ok(())
    }

    /// Sets where a body sits in its parent at rest, m.
    ///
    /// # Errors
    /// If there is no such body, or the position is not finite.
    pub fn set_body_pos(&mut self, body: usize, pos: Vector3<f64>) -> Result<(), MujocoError> {
        let body = checked("body", body, self.model.bodies())?;
        finite(&pos, "a body's position")?;
        // SAFETY: the model is alive, the index is checked, and the numbers are finite.
        unsafe { misfit_mj_set_body_pos(self.model.as_ptr(), body, pos.as_ptr()) };
        Ok(())
    }

    /// Poses of all bodies and sites at `qpos`; everything below reads them.
    ///
    /// # Errors
    /// If MuJoCo raises one.
    pub fn update_position(&mut self) -> Result<(), MujocoError> {
        // SAFETY: model and data are alive and belong together.
        done(unsafe { misfit_mj_position(self.model.as_ptr(), self.as_ptr()) })
    }

    /// Adds to [`Data::qfrc_applied`] what a force (N) and torque (N·m) at a point (m) of a body do to the
    /// joints; all three in the world's frame.
    ///
    /// # Errors
    /// If there is no such body, or a number is not finite.
    pub fn apply_force(
        &mut self,
        body: usize,
        point: &Vector3<f64>,
        force: &Vector3<f64>,
        torque: &Vector3<f64>,
    ) -> Result<(), MujocoError> {
        let body = checked("body", body, self.model.bodies())?;
        for vector in [point, force, torque] {
            finite(vector, "a force, torque or point")?;
        }
        // SAFETY: model and data are alive and belong together, the index is checked, and each vector has three numbers.
        done(unsafe {
            misfit_mj_apply(
                self.model.as_ptr(),
                self.as_ptr(),
                force.as_ptr(),
                torque.as_ptr(),
                point.as_ptr(),
                body,
            )
        })
    }

    /// What is left of the torques at rest, by degree of freedom, N·m (N): springs, less what gravity asks
    /// for, plus what is applied. Zero where the robot is in equilibrium. Tendons and actuators are not in
    /// it.
    ///
    /// # Errors
    /// If `residual` has not one number for each degree of freedom.
    pub fn static_residual(&mut self, residual: &mut [f64]) -> Result<(), MujocoError> {
        let dofs = self.model.dofs();
        if residual.len() != dofs {
            return Err(MujocoError::Value(format!(
                "{} residuals for {dofs} degrees of freedom",
                residual.len()
            )));
        }
        // SAFETY: model and data are alive and belong together; the length is checked above.
        done(unsafe {
            misfit_mj_static_residual(self.model.as_ptr(), self.as_ptr(), residual.as_mut_ptr())
        })
    }

    /// Sets the force (N) and torque (N·m) on a body at its centre of mass, in the world's frame, that
    /// sensors and [`Data::inverse`] know of; [`Data::static_residual`] does not.
    ///
    /// # Errors
    /// If there is no such body, or a number is not finite.
    pub fn set_external_wrench(
        &mut self,
        body: usize,
        force: &Vector3<f64>,
        torque: &Vector3<f64>,
    ) -> Result<(), MujocoError> {
        let bodies = self.model.bodies();
        checked("body", body, bodies)?;
        for vector in [force, torque] {
            finite(vector, "a force or torque")?;
        }
        let wrench = &mut self.array_mut(Array::XfrcApplied, 6 * bodies)[6 * body..6 * body + 6];
        wrench[..3].copy_from_slice(force.as_slice());
        wrench[3..].copy_from_slice(torque.as_slice());
        Ok(())
    }

    /// Torques that the joints would need to stay at rest beside their springs, by degree of freedom,
    /// N·m (N): MuJoCo's whole inverse dynamics.
    ///
    /// # Errors
    /// If MuJoCo raises one.
    pub fn inverse(&mut self) -> Result<&[f64], MujocoError> {
        // SAFETY: model and data are alive and belong together.
        done(unsafe { misfit_mj_inverse(self.model.as_ptr(), self.as_ptr()) })?;
        Ok(self.array(Array::QfrcInverse, self.model.dofs()))
    }

    /// Reads the force and torque sensors of the robot at rest.
    ///
    /// # Errors
    /// If MuJoCo raises one.
    pub fn update_sensors(&mut self) -> Result<(), MujocoError> {
        // SAFETY: model and data are alive and belong together.
        done(unsafe { misfit_mj_sensors_at_rest(self.model.as_ptr(), self.as_ptr()) })
    }

    /// The last reading of a sensor. Force and torque sensors give what the site's parent exerts on the
    /// site's body, in the site's frame.
    ///
    /// # Errors
    /// If there is no such sensor.
    pub fn sensor(&self, sensor: usize) -> Result<&[f64], MujocoError> {
        let sensor = checked("sensor", sensor, self.model.sensors())?;
        let (mut address, mut dimension) = (0, 0);
        // SAFETY: the model is alive, the index is checked, and both numbers are ours to be written.
        unsafe {
            misfit_mj_sensor(
                self.model.as_ptr(),
                sensor,
                &raw mut address,
                &raw mut dimension,
            )
        };
        let all = self.array(Array::Sensordata, self.model.size(Size::Nsensordata));
        let start = address.max(0) as usize;
        all.get(start..start + dimension.max(0) as usize)
            .ok_or_else(|| MujocoError::Value("a sensor beyond the data".to_owned()))
    }

    /// world_from_body.
    ///
    /// # Errors
    /// If there is no such body.
    pub fn body_pose(&self, body: usize) -> Result<Isometry3<f64>, MujocoError> {
        let bodies = self.model.bodies();
        checked("body", body, bodies)?;
        let position = &self.array(Array::Xpos, 3 * bodies)[3 * body..3 * body + 3];
        let q = &self.array(Array::Xquat, 4 * bodies)[4 * body..4 * body + 4];
        Ok(Isometry3::from_parts(
            Translation3::from(Vector3::from_column_slice(position)),
            UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3])),
        ))
    }

    /// Centre of mass of a body in the world's frame, m.
    ///
    /// # Errors
    /// If there is no such body.
    pub fn body_com(&self, body: usize) -> Result<Vector3<f64>, MujocoError> {
        let bodies = self.model.bodies();
        checked("body", body, bodies)?;
        Ok(Vector3::from_column_slice(
            &self.array(Array::Xipos, 3 * bodies)[3 * body..3 * body + 3],
        ))
    }

    /// Position of a site in the world's frame, m.
    ///
    /// # Errors
    /// If there is no such site.
    pub fn site_position(&self, site: usize) -> Result<Vector3<f64>, MujocoError> {
        let sites = self.model.sites();
        checked("site", site, sites)?;
        Ok(Vector3::from_column_slice(
            &self.array(Array::SiteXpos, 3 * sites)[3 * site..3 * site + 3],
        ))
    }

    /// world_from_site rotation matrix.
    ///
    /// # Errors
    /// If there is no such site.
    pub fn site_rotation(&self, site: usize) -> Result<Matrix3<f64>, MujocoError> {
        let sites = self.model.sites();
        checked("site", site, sites)?;
        Ok(Matrix3::from_row_slice(
            &self.array(Array::SiteXmat, 9 * sites)[9 * site..9 * site + 9],
        ))
    }

    /// Jacobians of a site's translation (m) and rotation (rad) in the world's frame, a column for each
    /// degree of freedom.
    ///
    /// # Errors
    /// If there is no such site.
    pub fn site_jacobian(
        &mut self,
        site: usize,
    ) -> Result<(Matrix3xX<f64>, Matrix3xX<f64>), MujocoError> {
        let site = checked("site", site, self.model.sites())?;
        let dofs = self.model.dofs();
        let (mut translation, mut rotation) = (vec![0.0; 3 * dofs], vec![0.0; 3 * dofs]);
        // SAFETY: model and data are alive and belong together, the index is checked, and both arrays have 3 × dofs numbers.
        done(unsafe {
            misfit_mj_jac_site(
                self.model.as_ptr(),
                self.as_ptr(),
                translation.as_mut_ptr(),
                rotation.as_mut_ptr(),
                site,
            )
        })?;
        Ok((
            Matrix3xX::from_row_slice(&translation),
            Matrix3xX::from_row_slice(&rotation),
        ))
    }

    fn as_ptr(&self) -> *mut c_void {
        self.pointer.as_ptr()
    }

    fn array(&self, which: Array, length: usize) -> &[f64] {
        // SAFETY: model and data are alive and belong together, and `Array` lists the arrays that the shim knows.
        let start = unsafe { misfit_mj_array(self.model.as_ptr(), self.as_ptr(), which as c_int) };
        if start.is_null() || length == 0 {
            return &[];
        }
        // SAFETY: the length is the one MuJoCo allocated; both live and stay as long as `self`.
        unsafe { std::slice::from_raw_parts(start, length) }
    }

    fn array_mut(&mut self, which: Array, length: usize) -> &mut [f64] {
        // SAFETY: model and data are alive and belong together, and `Array` lists the arrays that the shim knows.
        let start = unsafe { misfit_mj_array(self.model.as_ptr(), self.as_ptr(), which as c_int) };
        if start.is_null() || length == 0 {
            return &mut [];
        }
        // SAFETY: the length is the one MuJoCo allocated; both live and stay as long as `self`.
        unsafe { std::slice::from_raw_parts_mut(start, length) }
    }
}

impl Drop for Data {
    fn drop(&mut self) {
        // SAFETY: the pointer came from the shim, is freed once, and nothing uses it after.
        unsafe { misfit_mj_free_data(self.as_ptr()) }
    }
}

/// What MuJoCo warned of on this thread since the last call, a line each.
pub fn take_warnings() -> Vec<String> {
    let mut text = vec![0u8; 4096];
    // SAFETY: the text has as many bytes as the call is told.
    let length = unsafe { misfit_mj_take_warnings(text.as_mut_ptr().cast(), text.len()) };
    text.truncate(length);
    String::from_utf8_lossy(&text)
        .lines()
        .map(str::to_owned)
        .collect()
}

/// Whether MuJoCo can be used, and if not, why.
///
/// # Errors
/// The reason.
pub fn check() -> Result<(), MujocoError> {
    library::open()
}

/// Loads one library file; tells the version of the headers and of the library if they differ.
fn open_library(path: &str) -> Result<(), OpenError> {
    let c_path =
        CString::new(path).map_err(|_| OpenError::Missing("a path with a zero byte".to_owned()))?;
    let mut version = 0;
    // SAFETY: the path ends in a zero byte and outlives the call; the number is ours to be written.
    match unsafe { misfit_mj_open(c_path.as_ptr(), &raw mut version) } {
        0 => Ok(()),
        -2 => Err(OpenError::Version(version)),
        _ => Err(OpenError::Missing(message())),
    }
}

enum OpenError {
    Missing(String),
    Version(c_int),
}

/// `mjVERSION_HEADER`, or `None` if built without headers.
fn header_version() -> Option<c_int> {
    // SAFETY: both take nothing and return constants of the build.
    let available = unsafe { misfit_mj_available() } != 0;
    // SAFETY: as above.
    available.then(|| unsafe { misfit_mj_header_version() })
}

/// Where the build found the library; empty if it did not.
fn build_library() -> String {
    // SAFETY: the shim returns a constant text that ends in a zero byte.
    unsafe { CStr::from_ptr(misfit_mj_build_library()) }
        .to_string_lossy()
        .into_owned()
}

/// What the shim last complained of on this thread.
fn message() -> String {
    // SAFETY: the shim returns text of the calling thread that ends in a zero byte and lives until its next call.
    unsafe { CStr::from_ptr(misfit_mj_message()) }
        .to_string_lossy()
        .trim()
        .to_owned()
}

fn done(status: c_int) -> Result<(), MujocoError> {
    if status == 0 {
        Ok(())
    } else {
        Err(MujocoError::Computation(message()))
    }
}

fn checked(what: &'static str, index: usize, count: usize) -> Result<c_int, MujocoError> {
    match c_int::try_from(index) {
        Ok(small) if index < count => Ok(small),
        _ => Err(MujocoError::Index { what, index, count }),
    }
}

fn finite(vector: &Vector3<f64>, what: &str) -> Result<(), MujocoError> {
    if vector.iter().all(|x| x.is_finite()) {
        Ok(())
    } else {
        Err(MujocoError::Value(format!("{what} that is not finite")))
    }
}

/// In the order of `enum misfit_size`.
#[derive(Clone, Copy)]
enum Size {
    Nq,
    Nv,
    Nbody,
    Njoint,
    Nsite,
    Nsensor,
    Nsensordata,
}

/// In the order of `enum misfit_array`.
#[derive(Clone, Copy)]
enum Array {
    Qpos,
    QposSpring,
    QfrcApplied,
    QfrcInverse,
    QfrcPassive,
    QfrcBias,
    XfrcApplied,
    Xpos,
    Xquat,
    Xipos,
    SiteXpos,
    SiteXmat,
    Sensordata,
}

unsafe extern "C" {
    fn misfit_mj_available() -> c_int;
    fn misfit_mj_header_version() -> c_int;
    fn misfit_mj_build_library() -> *const c_char;
    fn misfit_mj_message() -> *const c_char;
    fn misfit_mj_take_warnings(text: *mut c_char, capacity: usize) -> usize;
    fn misfit_mj_open(path: *const c_char, version: *mut c_int) -> c_int;
    fn misfit_mj_load(path: *const c_char, model: *mut *mut c_void) -> c_int;
    fn misfit_mj_copy_model(model: *const c_void, copy: *mut *mut c_void) -> c_int;
    fn misfit_mj_free_model(model: *mut c_void);
    fn misfit_mj_make_data(model: *const c_void, data: *mut *mut c_void) -> c_int;
    fn misfit_mj_free_data(data: *mut c_void);
    fn misfit_mj_size(model: *const c_void, which: c_int) -> c_int;
    fn misfit_mj_id(model: *const c_void, kind: c_int, name: *const c_char) -> c_int;
    fn misfit_mj_joint(
        model: *const c_void,
        joint: c_int,
        kind: *mut c_int,
        qpos: *mut c_int,
        dof: *mut c_int,
    );
    fn misfit_mj_sensor(
        model: *const c_void,
        sensor: c_int,
        address: *mut c_int,
        dimension: *mut c_int,
    );
    fn misfit_mj_body_mass(model: *const c_void, body: c_int) -> c_double;
    fn misfit_mj_body_ipos(model: *const c_void, body: c_int, ipos: *mut c_double);
    fn misfit_mj_body_pos(model: *const c_void, body: c_int, pos: *mut c_double);
    fn misfit_mj_body_parent(model: *const c_void, body: c_int) -> c_int;
    fn misfit_mj_array(model: *mut c_void, data: *mut c_void, which: c_int) -> *mut c_double;
    fn misfit_mj_set_body_mass(model: *mut c_void, body: c_int, mass: c_double);
    fn misfit_mj_set_body_ipos(model: *mut c_void, body: c_int, ipos: *const c_double);
    fn misfit_mj_set_body_pos(model: *mut c_void, body: c_int, pos: *const c_double);
    fn misfit_mj_position(model: *const c_void, data: *mut c_void) -> c_int;
    fn misfit_mj_static_residual(
        model: *const c_void,
        data: *mut c_void,
        out: *mut c_double,
    ) -> c_int;
    fn misfit_mj_apply(
        model: *const c_void,
        data: *mut c_void,
        force: *const c_double,
        torque: *const c_double,
        point: *const c_double,
        body: c_int,
    ) -> c_int;
    fn misfit_mj_jac_site(
        model: *const c_void,
        data: *mut c_void,
        translation: *mut c_double,
        rotation: *mut c_double,
        site: c_int,
    ) -> c_int;
    fn misfit_mj_sensors_at_rest(model: *const c_void, data: *mut c_void) -> c_int;
    fn misfit_mj_inverse(model: *const c_void, data: *mut c_void) -> c_int;
    #[cfg(test)]
    fn misfit_mj_raise(warning: c_int) -> c_int;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_warnings_that_mujoco_raises_come_back_on_their_thread() {
        check().expect("MuJoCo");
        // SAFETY: the shim only raises what it is told, on the calling thread.
        let raise = |warning| done(unsafe { misfit_mj_raise(warning) });
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..1000 {
                        let error = raise(0).expect_err("an error was raised");
                        assert!(error.to_string().contains("raised for a test"), "{error}");
                    }
                    raise(1).expect("a warning is no error");
                    let warnings = take_warnings();
                    assert!(warnings.len() == 1 && warnings[0].contains("raised for a test"));
                });
            }
        });
        assert!(take_warnings().is_empty());
        assert!(!Path::new("MUJOCO_LOG.TXT").exists());
    }
}
