// The plugin by a function instead of a class loader.
#pragma once
#define PLUGINLIB_EXPORT_CLASS(derived, base) \
    base * make_plugin() { return new derived; }
