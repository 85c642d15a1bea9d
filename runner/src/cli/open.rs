//! From the words on the command line to a packed scene.

use std::{path::Path, time::Instant};

use weir::{
    packed::PackedScene,
    scene::{
        Camera, Scene, builtin, camera, environment,
        error::{Place, SceneError},
        load::{LoadOptions, load},
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

/// Reads or builds the scene; warnings go to stderr. Also the knobs, because some concern the scene.
pub fn read(arguments: &SceneArguments) -> anyhow::Result<(Scene, Settings)> {
    let mut settings = Settings::default();
    for assignment in &arguments.set {
        settings.apply(assignment)?;
    }
    settings.check()?;
    let start = Instant::now();
    let built_in = builtin::find(&arguments.scene).filter(|_| !Path::new(&arguments.scene).is_file());
    let mut scene = if let Some(built_in) = built_in {
        let mut scene = (built_in.build)();
        if arguments.lambert {
            scene.make_lambertian();
        }
        if arguments.flat {
            scene.meshes.iter_mut().for_each(|mesh| mesh.normals.clear());
        }
        scene
    } else {
        let path = Path::new(&arguments.scene);
        if !path.exists() && path.extension().is_none() {
            let names: Vec<_> = builtin::BUILTIN.iter().map(|b| b.name).collect();
            let help = format!("name an .obj file, or one of the built-in scenes: {}", names.join(", "));
            return Err(SceneError::no_input(&arguments.scene, "there is no such file or built-in scene", help).into());
        }
        let options = LoadOptions {
            lambert: arguments.lambert,
            flat: arguments.flat,
            texture_budget_bytes: arguments.texture_budget,
            asset_root: arguments.asset_root.clone(),
            max_file_bytes: arguments.max_size,
        };
        let loaded = load(path, &options)?;
        loaded.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        loaded.scene
    };
    if let Some(path) = &arguments.environment {
        let (map, warnings) = environment::load(path, arguments.environment_rotation, arguments.environment_scale)?;
        warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        scene.environment = Some(map);
    }
    scene.validate()?;
    tracing::info!(
        "{}: {} triangles in {} instances, {} emissive; read in {:.2} s",
        scene.name,
        scene.triangle_count(),
        scene.instances.len(),
        scene.emissive_triangle_count(),
        start.elapsed().as_secs_f64()
    );
    Ok((scene, settings))
}

/// The camera of `--camera`, or else the scene's, or else one that sees all of it.
pub fn camera_of(arguments: &SceneArguments, scene: &Scene) -> Result<Camera, SceneError> {
    match (&arguments.camera, scene.camera) {
        (Some(path), _) => camera::load(path),
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
    let camera = camera_of(arguments, &scene)?;
    let start = Instant::now();
    let packed = PackedScene::new(&scene, settings.time_s)?;
    if packed.has().is_empty() {
        tracing::warn!("{}: nothing emits light; only `Ke` and an environment map do", scene.name);
    }
    tracing::info!(
        "packed in {:.2} s: {:.1} MiB",
        start.elapsed().as_secs_f64(),
        packed.bytes() as f64 / f64::from(1 << 20)
    );
    Ok(Opened { name: scene.name, packed, camera, settings })
}
