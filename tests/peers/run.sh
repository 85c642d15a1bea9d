#!/bin/sh
# weir, Mitsuba 3 and Cycles at direct light, on one machine: relMSE less the reference's noise, seconds, their product,
# and HDR-FLIP. Lambertian surfaces, geometric normals.
#
#     tests/peers/run.sh SCENE [CAMERA.json] [REFERENCE.exr]
#
# Needs Python 3.11 with venv, PyPI, and for Mitsuba's fast variants libLLVM of version 15 or newer (VARIANT=scalar_rgb does
# without). A reference is rendered for REFERENCE_TIME seconds if none is given. PEERS names the folder for all of it;
# SPP and CYCLES_SPP the samples a pixel, WEIR_SET knobs of weir.
set -eu
scene=$1
camera=${2:-}
reference=${3:-}
here=$(dirname "$0")
weir=${WEIR:-target/release/weir}
work=${PEERS:-target/peers}
size=${SIZE:-320x180}
variant=${VARIANT:-llvm_ad_rgb}
mkdir -p "$work"
python="$work/venv/bin/python"
if [ ! -f "$work/venv/complete" ]; then
    python3 -m venv "$work/venv"
    "$work/venv/bin/pip" install --quiet mitsuba==3.9.1 bpy==5.0.1 flip-evaluator==1.7 OpenEXR numpy
    touch "$work/venv/complete"
fi

name=$(basename "$scene" .obj)
exported="$work/$name"
options="--lambert --flat"
[ -n "$camera" ] && options="$options --camera $camera"
# shellcheck disable=SC2086
[ -d "$exported" ] || "$weir" export "$scene" "$exported" $options >&2
obj=$(ls "$exported"/*.obj)
view=$(ls "$exported"/*-camera.json)
if [ -z "$reference" ]; then
    reference="$work/$name-reference.exr"
    # Neither neighbours nor history: independent of what is measured.
    # shellcheck disable=SC2086
    [ -f "$reference" ] || "$weir" render "$scene" $options --size "$size" --integrator ris --set candidates.count=16 \
        --set candidates.tree=12 --backend "${BACKEND:-cpu}" --time "${REFERENCE_TIME:-120}" --seed 99 -o "$reference" >&2
fi

row() { # name, seconds, picture
    error=$("$weir" compare "$3" "$reference" --fail 1e30 --warn 1e30 --json | "$python" -c '
import json, sys
found = json.load(sys.stdin)
print(found["rel_mse"] - (found["rel_mse_of_reference_noise"] or 0.0))')
    flip=$("$python" "$here/hdr_flip.py" "$reference" "$3")
    "$python" -c "print(f'$1 | {$2:.2f} | {$error:.5f} | {$2 * $error:.4f} | $flip')"
}

# The peer's picture, and weir's in the same time.
rows() { # name, script, samples, options of the script
    name_of_row=$1 script=$2 spp=$3
    shift 3
    picture="$work/$name-${script%.py}-$spp.exr"
    seconds=$("$python" "$here/$script" "$obj" "$view" "$picture" --spp "$spp" --size "$size" "$@")
    row "$name_of_row, $spp samples" "$seconds" "$picture"
    picture="$work/$name-weir-${script%.py}-$spp.exr"
    # shellcheck disable=SC2086
    "$weir" render "$scene" $options --size "$size" --backend "${BACKEND:-cpu}" --time "$seconds" ${WEIR_SET:-} \
        -o "$picture" >/dev/null
    row "weir, as long" "$seconds" "$picture"
}

echo "method | seconds | relMSE | relMSE x seconds | HDR-FLIP"
for spp in ${SPP:-16 64 256}; do
    rows "Mitsuba $variant" mitsuba_direct.py "$spp" --variant "$variant"
done
for spp in ${CYCLES_SPP:-16 64}; do
    rows "Cycles, light tree" cycles_direct.py "$spp"
done
