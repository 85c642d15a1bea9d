#!/bin/sh
# weir and Mitsuba 3 at direct light, on one machine: relMSE less the reference's noise, seconds, and their product.
# Lambertian surfaces, geometric normals.
#
#     tests/peers/run.sh SCENE [CAMERA.json] [REFERENCE.exr]
#
# Needs Python 3 with venv, PyPI, and for Mitsuba's fast variants libLLVM of version 15 or newer (VARIANT=scalar_rgb does
# without). A reference is rendered for REFERENCE_TIME seconds if none is given. PEERS names the folder for all of it.
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
if [ ! -x "$python" ]; then
    python3 -m venv "$work/venv"
    "$work/venv/bin/pip" install --quiet mitsuba==3.9.1 numpy
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
    "$python" -c "print(f'$1 | {$2:.2f} | {$error:.5f} | {$2 * $error:.4f}')"
}

echo "method | seconds | relMSE | relMSE x seconds"
for spp in ${SPP:-16 64 256}; do
    picture="$work/$name-mitsuba-$spp.exr"
    seconds=$("$python" "$here/mitsuba_direct.py" "$obj" "$view" "$picture" --spp "$spp" --size "$size" --variant "$variant")
    row "Mitsuba $variant, $spp samples" "$seconds" "$picture"
    picture="$work/$name-weir-$spp.exr"
    # The time that Mitsuba took.
    # shellcheck disable=SC2086
    "$weir" render "$scene" $options --size "$size" --backend "${BACKEND:-cpu}" --time "$seconds" -o "$picture" >/dev/null
    row "weir, as long" "$seconds" "$picture"
done
