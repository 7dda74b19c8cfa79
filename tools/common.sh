# common.sh: what tools/demo and tools/gpu-check share. To be sourced; needs bash, awk and sed alone.

# Chooses lavapipe, Mesa's driver that needs no GPU, where it is installed; says which driver is used.
use_lavapipe() {
    local json
    for json in /usr/share/vulkan/icd.d/lvp_icd."$(uname -m)".json /usr/share/vulkan/icd.d/lvp_icd*.json; do
        if [ -e "$json" ]; then
            # The second name is what older loaders know.
            export VK_DRIVER_FILES=$json VK_ICD_FILENAMES=$json
            echo "driver: lavapipe ($json)"
            return
        fi
    done
    echo "driver: what the Vulkan loader finds; lavapipe is not installed"
}

# number FILE KEY: the number behind "KEY": in one of our JSON files; "equal" where it is null.
number() {
    awk -v key="\"$2\":" '$1 == key { sub(/,$/, "", $2); print $2 == "null" ? "equal" : $2; exit }' "$1"
}

# device_ms FILE: time of all passes on the device, without the upload of voxels.
device_ms() {
    awk '$1 == "\"pass\":" { upload = $2 ~ /upload/ }
        $1 == "\"ms\":" && !upload { sub(/,$/, "", $2); sum += $2 }
        END { printf "%.0f", sum }' "$1"
}

# decibels FILE KEY: rounded, for a table.
decibels() {
    number "$1" "$2" | awk '{ if ($1 + 0 == $1) printf "%.1f", $1; else print $1 }'
}

# table_row NAME STATS COMPARISON: one line of the table that table_head begins.
table_row() {
    printf '| %-26s | %8.0f | %9s | %11.1f | %9s | %12s |\n' "$1" "$(number "$2" wall_ms)" \
        "$(device_ms "$2")" "$(number "$2" samples | awk '{ print $1 * 1e-6 }')" \
        "$(decibels "$3" psnr_db)" "$(decibels "$3" covered_psnr_db)"
}

table_head() {
    echo '| scene and view             | time, ms | device ms | samples, M  | PSNR, dB  | covered only |'
    echo '|----------------------------|---------:|----------:|------------:|----------:|-------------:|'
}

# views_of SCENE: the names of its views.
views_of() {
    awk '/^\[\[view\]\]/ { view = 1 } view && /^name *=/ { split($0, part, "\""); print part[2]; view = 0 }' "$1"
}
