#!/bin/sh
# Makes three.min.js again from the packages that package-lock.json names. With `--check` it only compares.
set -eu
cd "$(dirname "$0")"
made="$(mktemp -d)"
trap 'rm -rf "$made"' EXIT
cp package.json package-lock.json three.js "$made"
(cd "$made" && npm ci --silent --no-audit --no-fund --ignore-scripts)
"$made/node_modules/.bin/esbuild" --version >/dev/null 2>&1 || (cd "$made" && npm rebuild --silent esbuild)
(cd "$made" && node_modules/.bin/esbuild three.js --bundle --minify --format=iife --global-name=THREE --target=es2020 --legal-comments=none --outfile=three.min.js --log-level=warning)
if [ "${1:-}" = --check ]; then
    cmp "$made/three.min.js" three.min.js
    cmp "$made/node_modules/three/LICENSE" three.LICENSE
else
    cp "$made/three.min.js" three.min.js
    cp "$made/node_modules/three/LICENSE" three.LICENSE
fi
