"""Which x_T* makes every motion settle, from any state that earlier motions leave in the friction?"""
