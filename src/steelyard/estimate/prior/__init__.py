"""Prior knowledge: masses and inertias of a model file, data sheets, bounds."""
