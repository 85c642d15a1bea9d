//! The camera in hand: orbit, pan, dolly, fly, focus, frame, bookmarks.

use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};

use crate::scene::{Camera, bounds::Bounds};

/// Nearest to straight up or down that the view gets, in radians.
const POLE: f32 = 0.01;
/// Radians of a drag across the height of the picture.
const TURN: f32 = 3.0;

/// Directions in which to fly, each in -1..=1: right, up, forward.
pub type Flight = Vec3;

/// A camera that is moved by hand.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Where it is.
    pub camera: Camera,
    /// Scene units a second when flying.
    pub speed: f32,
    /// What [`Rig::reset`] goes back to.
    home: Camera,
}

impl Rig {
    /// At `home`, in a scene of the given size.
    pub fn new(home: Camera, scene: Option<Bounds>) -> Self {
        let size = scene.map_or(1.0, |bounds| bounds.size().length());
        Self { camera: home, speed: (size * 0.08).max(1e-4), home }
    }

    fn forward(&self) -> Vec3 {
        (self.camera.target - self.camera.origin).normalize_or(Vec3::NEG_Z)
    }

    fn right(&self) -> Vec3 {
        self.forward().cross(self.camera.up).normalize_or(Vec3::X)
    }

    /// `vector` turned by drags of `x` and `y`, in shares of the height of the picture, but never over a pole.
    fn turned(&self, vector: Vec3, x: f32, y: f32) -> Vec3 {
        let up = self.camera.up.normalize_or(Vec3::Y);
        let about_up = Quat::from_axis_angle(up, -x * TURN);
        let angle = vector.angle_between(up);
        let tilt = (angle + y * TURN).clamp(POLE, std::f32::consts::PI - POLE) - angle;
        let axis = vector.cross(up).normalize_or(self.right());
        about_up * (Quat::from_axis_angle(axis, -tilt) * vector)
    }

    /// Around the target, by a drag in shares of the height of the picture.
    pub fn orbit(&mut self, x: f32, y: f32) {
        let arm = self.camera.origin - self.camera.target;
        self.camera.origin = self.camera.target + self.turned(arm, x, -y);
    }

    /// Looks elsewhere from where it stands, by a drag in shares of the height of the picture.
    pub fn look(&mut self, x: f32, y: f32) {
        let view = self.camera.target - self.camera.origin;
        self.camera.target = self.camera.origin + self.turned(view, x, y);
    }

    /// Sideways and up, so that the target follows the pointer; a drag in shares of the height of the picture.
    pub fn pan(&mut self, x: f32, y: f32) {
        let distance = self.camera.origin.distance(self.camera.target);
        let height = 2.0 * distance * (self.camera.vfov_deg.to_radians() / 2.0).tan();
        let up = self.right().cross(self.forward());
        let step = (up * y - self.right() * x) * height;
        self.camera.origin += step;
        self.camera.target += step;
    }

    /// Toward the target, or away from it; each step takes a tenth of the way.
    pub fn dolly(&mut self, steps: f32) {
        let arm = (self.camera.origin - self.camera.target) * 0.9_f32.powf(steps);
        if arm.is_finite() && arm.length() > 1e-5 {
            self.camera.origin = self.camera.target + arm;
        }
    }

    /// Flies for `seconds`.
    pub fn fly(&mut self, flight: Flight, seconds: f32, factor: f32) {
        let up = self.camera.up.normalize_or(Vec3::Y);
        let direction = self.right() * flight.x + up * flight.y + self.forward() * flight.z;
        let step = direction.normalize_or_zero() * self.speed * factor * seconds;
        self.camera.origin += step;
        self.camera.target += step;
    }

    /// Turns to `point`: orbits go around it from now on.
    pub fn focus(&mut self, point: Vec3) {
        if point.is_finite() && point.distance(self.camera.origin) > 1e-5 {
            self.go(Camera { target: point, ..self.camera });
        }
    }

    /// Backs away until all of `bounds` is in sight, looking the same way.
    pub fn frame(&mut self, bounds: Bounds) {
        let radius = (bounds.size().length() / 2.0).max(1e-4);
        let distance = radius / (self.camera.vfov_deg.to_radians() / 2.0).sin();
        let center = bounds.center();
        self.camera.origin = center - self.forward() * distance;
        self.camera.target = center;
    }

    /// Back to where it came in.
    pub fn reset(&mut self) {
        self.camera = self.home;
    }

    /// To another camera, unless that sees nothing.
    pub fn go(&mut self, camera: Camera) {
        if camera.check().is_ok() {
            self.camera = camera;
        }
    }
}

/// A camera as files and settings have it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredCamera {
    origin: [f32; 3],
    target: [f32; 3],
    up: [f32; 3],
    vfov_deg: f32,
}

impl From<Camera> for StoredCamera {
    fn from(camera: Camera) -> Self {
        let Camera { origin, target, up, vfov_deg } = camera;
        Self { origin: origin.to_array(), target: target.to_array(), up: up.to_array(), vfov_deg }
    }
}

impl From<StoredCamera> for Camera {
    fn from(stored: StoredCamera) -> Self {
        Self {
            origin: stored.origin.into(),
            target: stored.target.into(),
            up: stored.up.into(),
            vfov_deg: stored.vfov_deg,
        }
    }
}

/// The JSON that `--camera` reads.
pub fn camera_json(camera: Camera) -> String {
    serde_json::to_string_pretty(&StoredCamera::from(camera)).unwrap_or_default() + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::parse;

    fn rig() -> Rig {
        let home = Camera { origin: Vec3::new(0.0, 1.0, 5.0), target: Vec3::Y, up: Vec3::Y, vfov_deg: 60.0 };
        Rig::new(home, Bounds::of([Vec3::ZERO, Vec3::splat(2.0)]))
    }

    fn close(a: Vec3, b: Vec3) -> bool {
        a.distance(b) < 1e-4
    }

    #[test]
    fn an_orbit_keeps_the_distance_and_never_crosses_a_pole() {
        let mut rig = rig();
        rig.orbit(std::f32::consts::PI / TURN, 0.0);
        assert!(close(rig.camera.origin, Vec3::new(0.0, 1.0, -5.0)), "{}", rig.camera.origin);
        for _ in 0..50 {
            rig.orbit(0.01, 0.3);
            assert!((rig.camera.origin.distance(rig.camera.target) - 5.0).abs() < 1e-3);
            rig.camera.check().expect("still a picture");
        }
        assert!(rig.camera.origin.y > 5.9, "dragging down lifts the camera: {}", rig.camera.origin);
    }

    #[test]
    fn looking_turns_the_view_and_not_the_place() {
        let mut rig = rig();
        rig.look(0.1, 0.1);
        assert_eq!(rig.camera.origin, Vec3::new(0.0, 1.0, 5.0));
        assert!(rig.camera.target.x > 0.0 && rig.camera.target.y < 1.0, "{}", rig.camera.target);
    }

    #[test]
    fn a_pan_by_the_height_of_the_picture_moves_by_what_that_shows() {
        let mut rig = rig();
        rig.pan(0.0, 1.0);
        let height = 2.0 * 5.0 * 30.0_f32.to_radians().tan();
        assert!(close(rig.camera.origin, Vec3::new(0.0, 1.0 + height, 5.0)));
        assert!(close(rig.camera.target, Vec3::new(0.0, 1.0 + height, 0.0)));
    }

    #[test]
    fn a_dolly_goes_and_comes_back_and_never_through_the_target() {
        let mut rig = rig();
        rig.dolly(3.0);
        assert!(close(rig.camera.origin, Vec3::new(0.0, 1.0, 5.0 * 0.729)));
        rig.dolly(-3.0);
        assert!(close(rig.camera.origin, Vec3::new(0.0, 1.0, 5.0)));
        rig.dolly(1e6);
        rig.camera.check().expect("still a picture");
    }

    #[test]
    fn flight_follows_the_view_and_up_stays_up() {
        let mut rig = rig();
        rig.speed = 2.0;
        rig.fly(Vec3::Z, 0.5, 1.0);
        assert!(close(rig.camera.origin, Vec3::new(0.0, 1.0, 4.0)));
        rig.fly(Vec3::X + Vec3::Y, 1.0, 10.0);
        let share = 20.0 / 2.0_f32.sqrt();
        assert!(close(rig.camera.origin, Vec3::new(share, 1.0 + share, 4.0)), "{}", rig.camera.origin);
        assert!(close(rig.camera.target - rig.camera.origin, Vec3::new(0.0, 0.0, -5.0)));
    }

    #[test]
    fn framing_shows_every_corner() {
        let mut rig = rig();
        let bounds = Bounds { min: Vec3::new(-3.0, 0.0, 7.0), max: Vec3::new(9.0, 4.0, 8.0) };
        rig.frame(bounds);
        let view = rig.camera.target - rig.camera.origin;
        for corner in bounds.corners() {
            assert!((corner - rig.camera.origin).angle_between(view).to_degrees() < 30.01);
        }
    }

    #[test]
    fn a_camera_goes_to_json_and_back() {
        let camera = rig().camera;
        assert_eq!(parse(camera_json(camera).as_bytes(), "c.json").expect("what --camera reads"), camera);
    }

    #[test]
    fn a_camera_that_sees_nothing_is_not_taken() {
        let mut rig = rig();
        let before = rig.clone();
        rig.go(Camera { vfov_deg: 0.0, ..rig.camera });
        rig.focus(rig.camera.origin);
        rig.focus(Vec3::NAN);
        assert_eq!(rig, before);
    }
}
