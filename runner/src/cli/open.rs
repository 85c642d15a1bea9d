//! From the words on the command line to a packed scene.

use std::{path::Path, time::Instant};

use weir::{
    packed::{Moment, PackOptions, PackedScene},
    scene::{
        Camera, Scene, camera,
        choice::Choice,
        error::{Place, SceneError},
        load::{LoadOptions, Loaded},
    },
    settings::Settings,
};

use super::SceneArguments;

/// A scene, ready to render.
pub struct Opened {
    pub name: String,
    pub packed: PackedScene,
    pub camera: Camera,
    pub settings: Settings,
}

/// The scene by the words of the command line.
pub fn choice_of(arguments: &SceneArguments) -> Choice {
    Choice {
        scene: arguments.scene.clone(),
        options: LoadOptions {
            lambert: arguments.lambert,
            flat: arguments.flat,
            texture_budget_bytes: arguments.texture_budget,
            asset_root: arguments.asset_root.clone(),
            max_file_bytes: arguments.max_size,
            ..LoadOptions::default()
        },
        environment: arguments.environment.clone(),
        environment_rotation_deg: arguments.environment_rotation,
        environment_scale: arguments.environment_scale,
        lights: arguments.lights.clone(),
    }
}

/// Reads or builds the scene; warnings go to stderr. Also the knobs, because some concern the scene.
pub fn read(arguments: &SceneArguments) -> anyhow::Result<(Scene, Settings)> {
    let mut settings = Settings::default();
    for assignment in &arguments.set {
        settings.apply(assignment)?;
    }
    settings.check()?;
    let start = Instant::now();
    let Loaded { scene, warnings } = choice_of(arguments).read()?;
    warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    tracing::info!(
        "{}: {} triangles in {} instances, {} emissive, {} other lights; read in {:.2} s",
        scene.name,
        scene.triangle_count(),
        scene.instances.len(),
        scene.emissive_triangle_count(),
        scene.shape_count(),
        start.elapsed().as_secs_f64()
    );
    Ok((scene, settings))
}

/// A camera from a file, or from the text itself.
pub fn load_camera(words: &Path) -> Result<Camera, SceneError> {
    match words.to_str().filter(|text| text.starts_with('{')) {
        Some(text) => camera::parse(text.as_bytes(), "--camera"),
        None => camera::load(words),
    }
}

/// The camera of `--camera`, or else the scene's, or else one that sees all of it.
pub fn camera_of(arguments: &SceneArguments, scene: &Scene) -> Result<Camera, SceneError> {
    match (&arguments.camera, scene.camera) {
        (Some(path), _) => load_camera(path),
        (None, Some(camera)) => Ok(camera),
        (None, None) => scene
            .bounds()
            .map(Camera::framing)
            .ok_or_else(|| SceneError::bad_data(Place::new(&scene.name, 0), "the scene is empty", "add a triangle")),
    }
}

/// [`read`], then packs the scene and settles on a camera.
pub fn open(arguments: &SceneArguments) -> anyhow::Result<Opened> {
    let (scene, settings) = read(arguments)?;
    let options = PackOptions::of(&settings);
    pack(arguments, &scene, settings, options)
}

/// Packs a scene and settles on a camera.
pub fn pack(
    arguments: &SceneArguments,
    scene: &Scene,
    settings: Settings,
    options: PackOptions,
) -> anyhow::Result<Opened> {
    let camera = camera_of(arguments, scene)?;
    let start = Instant::now();
    let moment = Moment { time_s: settings.time_s, ..Moment::default() };
    let packed = PackedScene::with(scene, &moment, options)?;
    if !packed.content.shines() {
        tracing::warn!("{}: nothing emits light; only `Ke`, a file of lights and an environment map do", scene.name);
    }
    tracing::info!(
        "packed in {:.2} s: {:.1} MiB",
        start.elapsed().as_secs_f64(),
        packed.bytes() as f64 / f64::from(1 << 20)
    );
    Ok(Opened { name: scene.name.clone(), packed, camera, settings })
}
