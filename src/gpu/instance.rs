//! The Vulkan loader and instance, and what validation says.

use std::ffi::{CStr, CString, c_void};
use std::sync::{Arc, Mutex};

use ash::extensions::khr;
use ash::vk;

use crate::error::{Error, Result};

/// Whether the validation layers watch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Validation {
    /// They do not.
    Off,
    /// Core checks and synchronization validation; any message is kept.
    On,
}

/// What a validation layer said.
#[derive(Clone, Debug)]
pub struct Message {
    /// The layer's text.
    pub text: String,
}

#[derive(Debug, Default)]
pub(crate) struct Messages(Mutex<Vec<Message>>);

impl Messages {
    pub(crate) fn all(&self) -> Vec<Message> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).clone()
    }
}

/// The Vulkan loader and one instance.
pub struct Instance {
    pub(crate) raw: ash::Instance,
    pub(crate) debug_utils: Option<ash::extensions::ext::DebugUtils>,
    messenger: Option<vk::DebugUtilsMessengerEXT>,
    pub(crate) messages: Arc<Messages>,
    // Holds the loader's library open; dropped last.
    pub(crate) entry: ash::Entry,
}

/// What surfaces take, the first whatever the window system.
const OF_WINDOWS: [&CStr; 5] = [
    khr::Surface::name(),
    khr::XlibSurface::name(),
    khr::XcbSurface::name(),
    khr::WaylandSurface::name(),
    khr::Win32Surface::name(),
];
const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

impl Instance {
    /// Loads Vulkan and makes an instance of version 1.3.
    ///
    /// # Errors
    /// Exit code 4 when there is no loader, no Vulkan 1.3, or no validation layer where one is asked for.
    pub fn new(validation: Validation) -> Result<Arc<Instance>> {
        Instance::with(validation, &[])
    }

    /// As [`Instance::new`], for showing windows of every window system that the loader knows.
    ///
    /// # Errors
    /// As [`Instance::new`]; and when it knows none.
    pub fn for_windows(validation: Validation) -> Result<Arc<Instance>> {
        Instance::with(validation, &OF_WINDOWS)
    }

    /// With those of these extensions that the loader knows.
    fn with(validation: Validation, of_windows: &[&'static CStr]) -> Result<Arc<Instance>> {
        // SAFETY: the loader is the system's own Vulkan library, which upholds Vulkan's contract.
        let entry = unsafe { ash::Entry::load() }.map_err(|why| {
            Error::machine(format!(
                "no Vulkan loader on this machine ({why}): install libvulkan1 and a driver such as mesa-vulkan-drivers"
            ))
        })?;
        let version = entry
            .try_enumerate_instance_version()
            .map_err(|why| vulkan_failed("asking the Vulkan loader for its version", why))?
            .unwrap_or(vk::API_VERSION_1_0);
        if version < vk::API_VERSION_1_3 {
            return Err(Error::machine(format!(
                "the Vulkan loader offers {}.{}, but 1.3 is needed: install a newer libvulkan1",
                vk::api_version_major(version),
                vk::api_version_minor(version)
            )));
        }
        let known = entry
            .enumerate_instance_extension_properties(None)
            .map_err(|why| vulkan_failed("listing instance extensions", why))?;
        let is_known =
            |name: &CStr| known.iter().any(|known| name_of(&known.extension_name) == name);
        let debug_utils_known = is_known(DEBUG_UTILS);
        let of_windows: Vec<_> = of_windows.iter().filter(|name| is_known(name)).collect();
        if of_windows.len() == 1 {
            return Err(Error::machine(
                "Vulkan knows no window system here: install a driver for this desktop, or use `ashfall render`",
            ));
        }
        let mut layers = Vec::new();
        let mut extensions: Vec<_> = of_windows.iter().map(|name| name.as_ptr()).collect();
        if validation == Validation::On {
            let known = entry
                .enumerate_instance_layer_properties()
                .map_err(|why| vulkan_failed("listing Vulkan layers", why))?
                .iter()
                .any(|layer| name_of(&layer.layer_name) == VALIDATION_LAYER);
            if !known {
                return Err(Error::machine(
                    "validation was asked for, but the layer VK_LAYER_KHRONOS_validation is not here: install vulkan-validationlayers",
                ));
            }
            layers.push(VALIDATION_LAYER.as_ptr());
            extensions.push(vk::ExtValidationFeaturesFn::name().as_ptr());
        }
        if debug_utils_known || validation == Validation::On {
            extensions.push(DEBUG_UTILS.as_ptr());
        }
        let application = vk::ApplicationInfo::builder()
            .application_name(c"ashfall")
            .engine_name(c"ashfall")
            .api_version(vk::API_VERSION_1_3);
        let enabled = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features =
            vk::ValidationFeaturesEXT::builder().enabled_validation_features(&enabled);
        let messages = Arc::new(Messages::default());
        let mut messenger_info = messenger_info(&messages);
        let mut info = vk::InstanceCreateInfo::builder()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        if validation == Validation::On {
            info = info.push_next(&mut features).push_next(&mut messenger_info);
        }
        // SAFETY: every pointer in `info` lives until the call returns.
        let raw = unsafe { entry.create_instance(&info, None) }
            .map_err(|why| vulkan_failed("creating a Vulkan instance", why))?;
        let debug_utils = extensions
            .contains(&DEBUG_UTILS.as_ptr())
            .then(|| ash::extensions::ext::DebugUtils::new(&entry, &raw));
        let messenger = match &debug_utils {
            Some(debug_utils) if validation == Validation::On => {
                // SAFETY: `messages` outlives the messenger, which is destroyed with this instance.
                let made = unsafe {
                    debug_utils.create_debug_utils_messenger(&self::messenger_info(&messages), None)
                };
                Some(made.map_err(|why| vulkan_failed("creating a debug messenger", why))?)
            }
            _ => None,
        };
        Ok(Arc::new(Instance { raw, debug_utils, messenger, messages, entry }))
    }

    /// What validation has said so far.
    pub fn messages(&self) -> Vec<Message> {
        self.messages.all()
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: devices hold this instance in an Arc, so none is left; nothing else was made of it.
        unsafe {
            if let (Some(debug_utils), Some(messenger)) = (&self.debug_utils, self.messenger) {
                debug_utils.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

const DEBUG_UTILS: &CStr = ash::extensions::ext::DebugUtils::name();

/// A fixed array that Vulkan ends with a zero, as a string.
pub(crate) fn name_of(chars: &[std::ffi::c_char]) -> &CStr {
    CStr::from_bytes_until_nul(bytemuck::cast_slice(chars)).unwrap_or(c"")
}

/// A string for Vulkan; an inner zero ends it early.
pub(crate) fn c_string(text: &str) -> CString {
    let before_zero = text.split('\0').next().unwrap_or("");
    CString::new(before_zero).unwrap_or_default()
}

/// A Vulkan call that failed for a reason outside this program.
pub(crate) fn vulkan_failed(doing: &str, why: vk::Result) -> Error {
    let remedy = match why {
        vk::Result::ERROR_OUT_OF_DEVICE_MEMORY => {
            "the device's memory is full: lower --atlas-mib or --size"
        }
        vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            "this machine's memory is full: lower --ram-mib or --size"
        }
        vk::Result::ERROR_DEVICE_LOST => {
            "the device was lost: see the system's log, then try again"
        }
        vk::Result::ERROR_INITIALIZATION_FAILED | vk::Result::ERROR_INCOMPATIBLE_DRIVER => {
            "the driver does not start: check its installation with `ashfall devices`"
        }
        _ => "see the driver's documentation, and try another device with --device",
    };
    Error::machine(format!("{doing} failed ({why:?}): {remedy}"))
}

fn messenger_info(messages: &Arc<Messages>) -> vk::DebugUtilsMessengerCreateInfoEXT {
    vk::DebugUtilsMessengerCreateInfoEXT {
        message_severity: vk::DebugUtilsMessageSeverityFlagsEXT::WARNING
            | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
        message_type: vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION
            | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
        pfn_user_callback: Some(keep_message),
        p_user_data: Arc::as_ptr(messages).cast_mut().cast::<c_void>(),
        ..Default::default()
    }
}

/// The one message that is not kept: advice to copy in a layout of its own. An atlas is written by one
/// role while the other reads it, so it has no moment to change its layout.
const LAYOUT_ADVICE: &str = "UNASSIGNED-CoreValidation-DrawState-InvalidImageLayout";

/// # Safety
/// Vulkan alone calls it, with the user data given to the messenger.
unsafe extern "system" fn keep_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT,
    user_data: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan passes a valid message for the length of this call, and `user_data` is the
    // Messages that the instance keeps alive longer than its messenger.
    unsafe {
        let messages = &*user_data.cast::<Messages>();
        let text = if (*data).p_message.is_null() {
            String::new()
        } else {
            CStr::from_ptr((*data).p_message).to_string_lossy().into_owned()
        };
        if kind == vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE && text.contains(LAYOUT_ADVICE) {
            return vk::FALSE;
        }
        let mut list = messages.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        list.push(Message { text });
    }
    vk::FALSE
}
