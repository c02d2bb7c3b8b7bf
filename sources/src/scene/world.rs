//! All objects of a scene, and their positions at a time.

use super::conditions::Conditions;
use super::file::{BesideFile, BesideKind, ObjectFile, SceneFile};
use super::ground::Ground;
use super::lens::Glare;
use super::light::Light;
use super::material::{Look, Material};
use super::mesh::{Face, Mesh, Placement, Point};
use super::model;
use super::motion::Path;
use super::plan::PlanPose;
use super::route::{Route, Standpoint};
use super::streets::Streets;
use super::texture::hash;
use super::truth::{FIRST_OBJECT, ObjectClass, OwnMotion};
use super::view::{Pose, Surface};
use crate::limits::MAX_SCENE_OBJECTS;
use perception::rig::Rig;

/// Maximum distance of drawn objects, in metres.
const MAX_DRAWN_M: f64 = 220.0;

/// Maximum distance of reflected objects, in metres.
const MAX_MIRRORED_M: f64 = 90.0;

/// Objects farther behind a vehicle that turns are not drawn, in metres: no shadow reaches into the image.
const BEHIND_M: f64 = 12.0;

/// Half the width of the vehicle's path, in metres.
pub const HALF_PATH_M: f64 = 1.2;

#[derive(Clone, Debug)]
enum Place {
    /// Relative to the road.
    Along(Path),
    /// Relative to the vehicle.
    Ahead(Path),
}

/// An object of the scene.
#[derive(Clone, Debug)]
pub struct Instance {
    /// Class.
    pub class: ObjectClass,
    /// Whether the file lists it under `objects`.
    pub subject: bool,
    mesh: usize,
    place: Place,
    /// Number of the road along which it is placed.
    road: usize,
    /// Index of the row beside the road of which it is a piece.
    pub row: Option<usize>,
    shadow: Option<(Point, Point)>,
    /// Lateral position of the light below its lamp, in metres.
    pool_x_m: Option<f64>,
}

/// An object at its current position.
#[derive(Clone, Copy, Debug)]
pub struct Present {
    /// Index of the instance.
    pub instance: usize,
    /// Its axes and the middle of its near side, in the vehicle's frame.
    pub placement: Placement,
    /// Centre, metres right of the vehicle's path along the road.
    pub from_path_m: f64,
    /// Centre, lateral position on the road in metres.
    pub across_m: f64,
    /// Centre, metres right of the camera.
    pub lateral_m: f64,
    /// Size in metres: across, up, along.
    pub size_m: Point,
}

/// The objects of a scene and their motion.
#[derive(Debug)]
pub struct World {
    /// The file.
    pub file: SceneFile,
    /// Rendering parameters of its weather.
    pub conditions: Conditions,
    /// Rig of the cameras.
    pub rig: Rig,
    /// Image size in pixels.
    pub size: (usize, usize),
    height_m: f64,
    /// The road and the vehicle's motion along it.
    pub route: Route,
    ground: Ground,
    /// The ground, where the road bends or branches.
    streets: Option<Streets>,
    meshes: Vec<Mesh>,
    boxes: Vec<(Point, Point)>,
    instances: Vec<Instance>,
    /// Surfaces of the current frame; those of the ground come first.
    pub surfaces: Vec<Surface>,
    /// Light of the current frame: the sun stands still while the vehicle turns.
    pub light: Light,
    /// Glare of the sun in the current frame.
    pub glare: Option<Glare>,
    /// Number of ground surfaces.
    pub ground_surfaces: usize,
    /// Shadows and lamp light on the ground.
    pub shades: Vec<Surface>,
    /// The mirrored objects that a wet road reflects; empty on a dry one.
    pub mirrors: Vec<Surface>,
    /// Objects that may be in the image.
    pub present: Vec<Present>,
}

impl World {
    /// Builds the world described by a file, for a rig.
    pub fn new(file: SceneFile, rig: Rig, size: (usize, usize), height_m: f64) -> Self {
        let mut conditions = Conditions::new(file.weather);
        for (own, given) in conditions.sensors.iter_mut().zip([file.camera.left, file.camera.right]) {
            *own = given.unwrap_or(*own);
        }
        let route = Route::new(&file);
        let streets = route.turns().then(|| Streets::new(&file.road, &route));
        let mut world = Self {
            route,
            streets,
            light: conditions.light,
            glare: conditions.lens.glare,
            ground: Ground::new(&file.road),
            conditions,
            rig,
            size,
            height_m,
            meshes: Vec::new(),
            boxes: Vec::new(),
            instances: Vec::new(),
            surfaces: Vec::new(),
            ground_surfaces: 0,
            shades: Vec::new(),
            mirrors: Vec::new(),
            present: Vec::new(),
            file,
        };
        for n in 0..world.file.beside.len() {
            let row = world.file.beside[n].clone();
            world.add_row(n as u64, &row);
        }
        for n in 0..world.file.objects.len() {
            let object = world.file.objects[n].clone();
            world.add_object(n as u64, &object);
        }
        // Owner numbers have 16 bits; the limit of a scene's objects is far below.
        const { assert!(MAX_SCENE_OBJECTS < (u16::MAX - FIRST_OBJECT) as usize) };
        world
    }

    /// All objects.
    pub fn instances(&self) -> &[Instance] {
        &self.instances
    }

    /// Adds an object with its mesh.
    fn add(
        &mut self,
        class: ObjectClass,
        mesh: Mesh,
        yaw_deg: f64,
        place: Place,
        subject: bool,
    ) -> &mut Instance {
        // Applies the yaw once; then near side and centre become the origin.
        let turned = Placement::new([0.0; 3], yaw_deg.to_radians(), 0.0);
        let mesh = Mesh { faces: mesh.faces.iter().map(|face| turned.face(face)).collect() };
        let (least, greatest) = mesh.bounds();
        let shift = [-(least[0] + greatest[0]) / 2.0, 0.0, -least[2]];
        let moved = Placement::new(shift, 0.0, 0.0);
        let mesh = Mesh { faces: mesh.faces.iter().map(|face| moved.face(face)).collect() };
        let bounds = mesh.bounds();
        let shadow = match class {
            ObjectClass::Building => None,
            // Only the deck casts a shadow on the road.
            ObjectClass::Bridge => Some(([bounds.0[0], bounds.1[1] - 2.0, bounds.0[2]], bounds.1)),
            ObjectClass::Tree => {
                let inner = |a: f64, b: f64| a + 0.2 * (b - a);
                Some((
                    [inner(bounds.0[0], bounds.1[0]), 0.35 * bounds.1[1], inner(bounds.0[2], bounds.1[2])],
                    [inner(bounds.1[0], bounds.0[0]), 0.9 * bounds.1[1], inner(bounds.1[2], bounds.0[2])],
                ))
            }
            _ => Some(bounds),
        };
        self.meshes.push(mesh);
        self.boxes.push(bounds);
        self.instances.push(Instance {
            class,
            subject,
            mesh: self.meshes.len() - 1,
            place,
            road: 0,
            row: None,
            shadow,
            pool_x_m: None,
        });
        let last = self.instances.len() - 1;
        &mut self.instances[last]
    }

    fn add_row(&mut self, n: u64, row: &BesideFile) {
        let seconds = self.file.seconds;
        // In a repeating scene, objects one period further on have the same appearance.
        let round_m = self.file.ego.speed_m_s.integral(seconds);
        let side = if row.lateral_m < 0.0 { -1.0 } else { 1.0 };
        let spacing = row.spacing();
        for k in 0..row.count() {
            let along = row.from_m + k as f64 * spacing;
            let long = spacing * self.stretch(row, along);
            let round = if self.file.repeats && round_m > 0.0 { along.rem_euclid(round_m) } else { along };
            let key = hash(self.file.seed ^ n << 40 ^ ((round * 16.0).round() as i64 as u64) << 8);
            let (class, mesh, depth) = model::of_row(row, side, long, key);
            let lateral = row.lateral_m + side * depth / 2.0;
            let place = Place::Along(Path::even(along, lateral, 0.0, 0.0, seconds));
            let instance = self.add(class, mesh, 0.0, place, false);
            instance.road = row.branch.unwrap_or(0);
            instance.row = Some(n as usize);
            if row.kind == BesideKind::Lamps {
                instance.pool_x_m = Some(-side * 0.8);
                instance.shadow = None;
            }
        }
    }

    fn add_object(&mut self, n: u64, object: &ObjectFile) {
        let key = hash(self.file.seed ^ 0x0b1e_c700 ^ n << 20);
        let (class, mesh) = model::of_object(object, key);
        let seconds = self.file.seconds;
        let place = match (&object.path, &object.ahead) {
            (Some(path), _) => Place::Along(path.clone()),
            (_, Some(path)) => Place::Ahead(path.clone()),
            _ => {
                let along = object.along_m.unwrap_or(0.0);
                Place::Along(Path::even(
                    along,
                    object.lateral_m,
                    object.speed_m_s,
                    object.across_m_s,
                    seconds,
                ))
            }
        };
        self.add(class, mesh, object.yaw_deg, place, true).road = object.branch.unwrap_or(0);
    }

    /// Length beside the road of a metre along it: closed rows stay closed in bends.
    fn stretch(&self, row: &BesideFile, along_m: f64) -> f64 {
        let spacing = row.spacing();
        if !self.route.turns() {
            return 1.0;
        }
        let road = row.branch.unwrap_or(0);
        let at = |along_m| self.route.plan.at(road, along_m).point(row.lateral_m, 0.0);
        let ([ax, az], [bx, bz]) = (at(along_m), at(along_m + spacing));
        (bx - ax).hypot(bz - az) / spacing
    }

    /// Way of the vehicle to an object's near side, in metres.
    pub fn ahead_m(&self, instance: &Instance, time_s: f64) -> f64 {
        let along_m = self.route.along_m(time_s);
        let there_m = match &instance.place {
            Place::Along(path) if instance.road > 0 => {
                let (place, across) = path.at(time_s);
                let point = self.route.plan.at(instance.road, place).point(across, 0.0);
                self.route.plan.project(point, (along_m - MAX_DRAWN_M, along_m + MAX_DRAWN_M)).0
            }
            Place::Along(path) => path.at(time_s).0,
            Place::Ahead(path) if self.route.turns() => along_m + path.at(time_s).0,
            Place::Ahead(path) => return path.at(time_s).0,
        };
        if self.route.turns() {
            self.route.way_m(along_m, there_m, self.route.stand(time_s).lateral_m)
        } else {
            there_m - along_m
        }
    }

    /// Height of the road `ahead_m` metres farther along it, above the plane on which the vehicle stands, and the distance of
    /// that place ahead of the vehicle.
    pub fn road_ahead_m(&self, time_s: f64, ahead_m: f64) -> (f64, f64) {
        let along_m = self.route.along_m(time_s);
        if !self.route.turns() {
            return (ahead_m, self.route.course.spot(along_m, ahead_m).up_m);
        }
        let stand = self.route.stand(time_s);
        let there = self.route.plan.road(along_m + ahead_m).point(stand.lateral_m, 0.0);
        (ahead_m, stand.see(there, self.route.course.rise_m(along_m + ahead_m))[1])
    }

    /// The vehicle's own motion at a time.
    pub fn motion(&self, time_s: f64) -> OwnMotion {
        self.route.motion(time_s, &self.pose(0.0), &self.pose(time_s))
    }

    /// Positions all objects at a time.
    pub fn place(&mut self, time_s: f64) {
        let stand = self.route.stand(time_s);
        let pose = self.pose(time_s);
        let rig = self.rig;
        let wet = self.is_wet();
        self.light_from(&stand);
        let light = self.light;
        self.surfaces.clear();
        self.shades.clear();
        self.mirrors.clear();
        self.present.clear();
        let surfaces = &mut self.surfaces;
        let each = |face: &Face, owner| surfaces.extend(Surface::new(face, owner, &pose, &rig, &light));
        match &self.streets {
            Some(streets) => streets.faces(&stand, each),
            None => self.ground.faces(&self.route.course, stand.along_m, stand.lateral_m, each),
        }
        self.ground_surfaces = self.surfaces.len();
        for k in 0..self.instances.len() {
            let Some((placement, across)) = self.placement(k, time_s, &stand) else { continue };
            let instance = &self.instances[k];
            let (least, greatest) = self.boxes[instance.mesh];
            let owner = FIRST_OBJECT + k as u16;
            for face in &self.meshes[instance.mesh].faces {
                self.surfaces.extend(Surface::new(&placement.face(face), owner, &pose, &rig, &light));
                if wet && placement.at[2] < MAX_MIRRORED_M {
                    let mirrored = placement.face(&face.mirrored());
                    self.mirrors.extend(Surface::new(&mirrored, owner, &pose, &rig, &light));
                }
            }
            self.present.push(Present {
                instance: k,
                placement,
                from_path_m: across - stand.lateral_m,
                across_m: across,
                lateral_m: placement.at[0],
                size_m: [greatest[0] - least[0], greatest[1], greatest[2] - least[2]],
            });
            if let Some(bounds) = instance.shadow {
                self.shades.extend(shadow(bounds, &placement, &pose, &rig, &light, instance.class));
            }
            if let Some(x_m) = instance.pool_x_m.filter(|_| light.lamps) {
                self.shades.extend(pool(x_m, &placement, &pose, &rig, &light));
            }
        }
    }

    /// Where an object is in the vehicle's frame, and its position across its road; `None` if it is not drawn.
    fn placement(&self, k: usize, time_s: f64, stand: &Standpoint) -> Option<(Placement, f64)> {
        let instance = &self.instances[k];
        let (least, greatest) = self.boxes[instance.mesh];
        let course = &self.route.course;
        let (place, across) = match &instance.place {
            Place::Along(path) | Place::Ahead(path) => path.at(time_s),
        };
        let is_relative = matches!(instance.place, Place::Ahead(_));
        let up = self.foot_m(instance, across);
        if !self.route.turns() {
            let ahead = if is_relative { place } else { place - stand.along_m };
            if ahead > MAX_DRAWN_M || ahead + greatest[2] < -6.0 {
                return None;
            }
            let spot = course.spot(stand.along_m, ahead);
            let at = [across - stand.lateral_m, spot.up_m + up, ahead];
            return Some((Placement::new(at, 0.0, spot.slope), across));
        }
        let along = if is_relative { stand.along_m + place } else { place };
        let road = |along_m| self.route.plan.at(instance.road, along_m);
        let near = road(along).point(across, 0.0);
        // It lies along the chord between its ends.
        let long = greatest[2];
        let far = road(along + long).point(across, 0.0);
        let is_short = long < 0.1 || (far[0] - near[0]).hypot(far[1] - near[1]) < 0.5 * long;
        let heading =
            if is_short { road(along).heading_rad } else { (far[0] - near[0]).atan2(far[1] - near[1]) };
        let rise = if instance.road > 0 { 0.0 } else { course.rise_m(along) };
        let at = stand.see(near, rise + up);
        let yaw = heading - stand.at.heading_rad;
        let middle = at[2] + 0.5 * long * yaw.cos();
        let radius = long.max(greatest[0] - least[0]);
        if at[0].hypot(at[2]) > MAX_DRAWN_M || middle + radius < -BEHIND_M {
            return None;
        }
        let grade = if instance.road > 0 { 0.0 } else { course.grade(along) };
        Some((Placement::new(at, yaw, grade + stand.tilt() * yaw.cos()), across))
    }

    /// Height of the ground on which an object stands, above the asphalt, in metres.
    fn foot_m(&self, instance: &Instance, across: f64) -> f64 {
        let half = self.boxes[instance.mesh].1[0];
        let is_elsewhere = instance.road > 0 || instance.class == ObjectClass::Bridge;
        if is_elsewhere { 0.0 } else { self.ground.lowest_m(across - half, across + half) }
    }

    /// Turns the sun with the world.
    fn light_from(&mut self, stand: &Standpoint) {
        if !self.route.turns() {
            return;
        }
        let turned = |[x, y, z]: Point| {
            let (sin, cos) = stand.at.heading_rad.sin_cos();
            [x * cos - z * sin, y, x * sin + z * cos]
        };
        self.light.towards_sun = turned(self.conditions.light.towards_sun);
        // A sun that stands farther than 78 degrees to the side throws no light into the lens.
        let glare = self.conditions.lens.glare.map(|glare| (glare, turned([glare.at.0, -glare.at.1, 1.0])));
        self.glare = glare
            .filter(|(_, to)| to[2] > 0.2)
            .map(|(glare, to)| Glare { at: (to[0] / to[2], -to[1] / to[2]), ..glare });
    }

    /// Transforms a direction from the left camera to the world: x right, y up, z ahead.
    pub fn to_world(&self, time_s: f64) -> Option<[Point; 3]> {
        self.route.turns().then(|| {
            let heading_rad = self.route.stand(time_s).at.heading_rad;
            let turn = PlanPose { heading_rad, ..PlanPose::default() };
            self.pose(time_s).axes().map(|axis| {
                let [x, z] = turn.point(axis[0], axis[2]);
                [x, axis[1], z]
            })
        })
    }

    /// Whether the road reflects objects.
    pub fn is_wet(&self) -> bool {
        self.conditions.wet.max(self.file.road.wet) > 0.3
    }

    /// Pose of the left camera in the vehicle's frame.
    pub fn pose(&self, time_s: f64) -> Pose {
        let camera = &self.file.camera;
        let angle = |line: &Option<super::motion::Waypoints>, sway: f64, hz: f64| {
            let still = line.as_ref().map_or(0.0, |line| line.value(time_s));
            (still + sway * (std::f64::consts::TAU * hz * time_s).sin()).to_radians()
        };
        Pose::new(
            self.height_m,
            angle(&camera.pitch_deg, camera.sway_pitch_deg, 1.3),
            angle(&camera.roll_deg, camera.sway_roll_deg, 0.7),
        )
    }
}

/// Shadow of a box on the ground: the convex hull of its corners' shadows.
fn shadow(
    (least, greatest): (Point, Point),
    placement: &Placement,
    pose: &Pose,
    rig: &Rig,
    light: &Light,
    class: ObjectClass,
) -> Option<Surface> {
    let sunny = light.sun > 0.4 && light.towards_sun[1] > 0.1;
    // Without sun only the ground directly below is darkened (ambient occlusion).
    let lean = if sunny { 1.0 } else { 0.0 };
    let strength = match (sunny, class) {
        (_, ObjectClass::Bridge) => 1.0,
        (true, _) => 0.9,
        (false, _) => 0.5,
    };
    let towards = light.towards_sun;
    let mut points = [[0.0; 2]; 8];
    for (k, point) in points.iter_mut().enumerate() {
        let pick = |bit: usize, axis: usize| if k >> bit & 1 == 0 { least[axis] } else { greatest[axis] };
        let foot = placement.place([pick(0, 0), 0.0, pick(2, 2)]);
        // Limits the length of shadows: at a low sun they would cover everything.
        let up = pick(1, 1) * lean / towards[1].max(0.25);
        *point = [foot[0] - towards[0] * up, foot[2] - towards[2] * up];
    }
    let ground = placement.at;
    let slope = placement.axes[2][1] / placement.axes[2][2].max(0.1);
    let mut corners = [[0.0; 3]; 8];
    let count = hull(&mut points, &mut corners);
    for corner in &mut corners[..count] {
        corner[1] = ground[1] + slope * (corner[2] - ground[2]);
    }
    flat(&corners[..count], Material::new(Look::Plain, 0.0, strength, 1.0), pose, rig, light)
}

/// Light below a street lamp.
fn pool(x_m: f64, placement: &Placement, pose: &Pose, rig: &Rig, light: &Light) -> Option<Surface> {
    let corners: [Point; 8] = std::array::from_fn(|k| {
        let turn = std::f64::consts::TAU * k as f64 / 8.0;
        let foot = placement.place([x_m + 5.0 * turn.cos(), 0.0, 6.0 * turn.sin()]);
        [foot[0], placement.at[1], foot[2]]
    });
    flat(&corners, Material::new(Look::Plain, 0.0, 0.0, 1.0).glowing(0.3), pose, rig, light)
}

fn flat(corners: &[Point], material: Material, pose: &Pose, rig: &Rig, light: &Light) -> Option<Surface> {
    if corners.len() < 3 {
        return None;
    }
    Surface::new(&Face::new(corners, material), 0, pose, rig, light)
}

/// Convex hull of points (x, z), counter-clockwise. Returns its number of corners.
fn hull(points: &mut [[f64; 2]; 8], corners: &mut [Point; 8]) -> usize {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let turn =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let mut stack = [[0.0; 2]; 17];
    let mut count = 0;
    let mut least = 2;
    for &point in points.iter() {
        while count >= 2 && turn(stack[count - 2], stack[count - 1], point) <= 1e-9 {
            count -= 1;
        }
        stack[count] = point;
        count += 1;
    }
    least += count - 1;
    for &point in points.iter().rev().skip(1) {
        while count >= least && turn(stack[count - 2], stack[count - 1], point) <= 1e-9 {
            count -= 1;
        }
        stack[count] = point;
        count += 1;
    }
    // The last point repeats the first.
    let count = count.saturating_sub(1).min(8);
    for (corner, point) in corners.iter_mut().zip(&stack[..count]) {
        *corner = [point[0], 0.0, point[1]];
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_holds_all_points() {
        let mut points =
            [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0], [1.0, 0.5], [3.0, 0.5], [1.0, 0.0], [2.0, 1.0]];
        let mut corners = [[0.0; 3]; 8];
        let count = hull(&mut points, &mut corners);
        let found: Vec<[f64; 2]> = corners[..count].iter().map(|c| [c[0], c[2]]).collect();
        assert_eq!(found, [[0.0, 0.0], [2.0, 0.0], [3.0, 0.5], [2.0, 1.0], [0.0, 1.0]]);
    }
}
